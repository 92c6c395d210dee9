"""A limit in frames is a limit in time as well: it was chosen at 30 Hz, and a faster camera's frames take less."""

FRAME_NS = 33_333_333  # at 30 Hz


def have_lasted(frames: int, limit: int, elapsed_ns: int, jitter: float = 0.5) -> bool:
    """Whether these frames are as many as the limit, and took as long as so many at 30 Hz, less that part of a frame.

    elapsed_ns: since the frame before the first of them; negative, the clock went back: the frames decide alone.
    """
    return frames >= limit and not 0 <= elapsed_ns < (limit - jitter) * FRAME_NS


def row_has_lasted(row_ns: tuple[int, ...], limit: int, jitter: float = 0.5) -> bool:
    """The same of frames in a row, given their captures."""
    return bool(row_ns) and have_lasted(len(row_ns) - 1, limit - 1, row_ns[-1] - row_ns[0], jitter)
