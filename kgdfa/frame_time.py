"""A limit in frames is a limit in time as well: it was chosen at 30 Hz, and a faster camera's frames take less."""

from itertools import pairwise

FRAME_NS = 33_333_333  # at 30 Hz
ROW_JITTER = 0.2  # of a frame; with a half, 50 ms (four frames of 60 Hz, two misread ones of 30 Hz) would be enough
HOLE_NS = 2 * FRAME_NS  # longer is no jitter: a frame that comes late, and the one behind it early, take two together


def have_lasted(frames: int, limit: int, elapsed_ns: int, jitter: float = 0.5) -> bool:
    """Whether these frames are as many as the limit, and took as long as so many at 30 Hz, less that part of a frame.

    elapsed_ns: since the frame before the first of them; negative, the clock went back: the frames decide alone.
    """
    return frames >= limit and not 0 <= elapsed_ns < (limit - jitter) * FRAME_NS


def row_has_lasted(row_ns: tuple[int, ...], limit: int) -> bool:
    """The same of frames in a row, given their captures, less ROW_JITTER.

    A hole between two of them counts as one frame: a hand that was cut off for a second, and could not be read, was not
    read as anything for that second. A camera that loses frames makes such holes, too: without a press
    the vote counts their time as well.
    """
    steps_ns = (after_ns - before_ns for before_ns, after_ns in pairwise(row_ns))
    lasted_ns = sum(FRAME_NS if step_ns > HOLE_NS else step_ns for step_ns in steps_ns)
    return bool(row_ns) and have_lasted(len(row_ns) - 1, limit - 1, lasted_ns, ROW_JITTER)
