"""A film of a recording: frames at a fixed rate, written beside the target and moved there when whole.

OpenCV's writer reports no full disk: the disk's room is looked at with every second of film, and the finished film is
opened again before it takes its name.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum, auto
from pathlib import Path

import cv2

from app.playback import frame
from app.playback.frame import HEIGHT_PX, WIDTH_PX
from app.playback.moment import joints_over, moment, reports_between
from app.playback.pen import Image
from app.playback.session import Playback, ReplayFault, moment_ns
from app.playback.view import WINDOW_S, Figure, Legs, View, Whole
from app.system.errors import AppError
from app.system.files import partial_file
from hal.cameras.playback import open_video
from logs import records as r
from logs.reading.errors import cause_of
from logs.show import WEIGHT

FPS = 25
LEAST_FREE_BYTES = 32 << 20
LANDMARKS_S, MOST_LANDMARKS = 120.0, 5
WINDOW_NS = round(WINDOW_S * 1e9)
PUSHES = (r.Press, r.Release, r.Cancel, r.Hint)
LEAD_S = 2.0  # before a record that the film begins with


class FilmFault(Enum):
    """Why there is no film."""

    UNWRITABLE = auto()  # path, detail
    NO_FORMAT = auto()  # path
    DISK_FULL = auto()  # path, free_bytes
    NOT_WHOLE = auto()  # path, written, read


@dataclass(frozen=True, slots=True, kw_only=True)
class Stretch:
    """Which part of a recording a film shows: seconds from its beginning, and how fast."""

    from_s: float
    to_s: float
    speed: float = 1.0

    @property
    def frames(self) -> int:
        """Of its film; the last one is no later than its end."""
        return int((self.to_s - self.from_s) / self.speed * FPS + 1e-6) + 1


def stretch_of(
    playback: Playback, from_s: float | None, to_s: float | None, event: str = "", speed: float = 1.0
) -> Stretch:
    """The part that is asked for. With an event, both times count from it. Raises AppError when there is none."""
    begin_s, first_s, last_s = 0.0, 0.0 if from_s is None else from_s, to_s
    if event:
        begin_s = playback.seconds(moment_ns(playback.find(event)))
        first_s = -LEAD_S if from_s is None else from_s
    last_s = playback.duration_s if last_s is None else begin_s + last_s
    first_s = begin_s + first_s
    if not (first_s < playback.duration_s and last_s > max(first_s, 0.0)):
        raise AppError(
            ReplayFault.NO_SUCH_TIME,
            path=playback.path,
            from_s=first_s,
            to_s=last_s,
            duration_s=playback.duration_s,
        )
    return Stretch(from_s=max(first_s, 0.0), to_s=min(last_s, playback.duration_s), speed=speed)


def film(playback: Playback, target: Path, stretch: Stretch, step: Callable[[], object]) -> int:
    """Write it; how many frames. Nothing is left of a film that ends early. Raises AppError."""
    whole = whole_of(playback, stretch.speed)

    def images() -> Iterator[Image]:
        for view in views(playback, stretch):
            yield frame.draw(view, whole)
            step()

    write_film(target, images(), frames=stretch.frames, fps=FPS, size_px=(WIDTH_PX, HEIGHT_PX))
    return stretch.frames


def write_film(
    target: Path,
    images: Iterable[Image],
    *,
    frames: int,
    fps: int,
    size_px: tuple[int, int],
    free_bytes: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free,
) -> None:
    """Write so many images, BGR, of this width and height, as MP4. Nothing is left of a film that ends early.

    Raises AppError.
    """
    with _writable(target), partial_file(target) as partial:
        writer = cv2.VideoWriter(str(partial.absolute()), cv2.VideoWriter.fourcc(*"mp4v"), fps, size_px)
        if not writer.isOpened():
            raise AppError(FilmFault.NO_FORMAT, path=target)
        try:
            for number, image in enumerate(images):
                if number % fps == 0:
                    _check_room(target, free_bytes(target.absolute().parent))
                writer.write(image)
        finally:
            writer.release()
        _check_whole(partial, target, frames)
        partial.replace(target)


def views(playback: Playback, stretch: Stretch) -> Iterator[View]:
    """What each frame shows, in order."""
    legs = Legs(playback, playback.wearer())
    for number in range(stretch.frames):
        yield view_at(playback, legs, playback.at(stretch.from_s + number * stretch.speed / FPS))


def view_at(playback: Playback, legs: Legs, at_ns: int) -> View:
    """What a frame shows of one moment."""
    now = moment(playback, at_ns)
    pose = legs.at(now)
    measured, commanded = joints_over(playback, at_ns - WINDOW_NS, at_ns)
    landmarks = playback.landmarks.between(at_ns - round(LANDMARKS_S * 1e9), at_ns)
    pushes = [one for one in landmarks if isinstance(one.body, PUSHES) and moment_ns(one) > at_ns - WINDOW_NS]
    return View(
        moment=now,
        legs=None if pose is None else Figure(body=legs.wearer.body, pose=pose, scene=legs.footing.scene),
        measured=measured,
        commanded=commanded,
        reports=tuple(reports_between(playback, at_ns - WINDOW_NS, at_ns)),
        pushes=tuple((moment_ns(one), one) for one in pushes),
        landmarks=tuple((moment_ns(one), one) for one in landmarks[-MOST_LANDMARKS:]),
    )


def whole_of(playback: Playback, speed: float) -> Whole:
    """What all frames share."""
    return Whole(
        session=playback.name,
        patient=playback.profile().identifier,
        begin_ns=playback.begin_ns,
        end_ns=playback.end_ns,
        clock_offset_ns=playback.index.recording.clock_offset_ns,
        marks=tuple(
            (playback.seconds(moment_ns(one)), WEIGHT.get(type(one.body), ""))
            for one in playback.landmarks.between(playback.begin_ns - 1, playback.end_ns)
        ),
        speed=speed,
    )


@contextmanager
def _writable(target: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise AppError(FilmFault.UNWRITABLE, path=target, detail=cause_of(error)) from error


def _check_room(target: Path, free_bytes: int) -> None:
    if free_bytes < LEAST_FREE_BYTES:
        raise AppError(FilmFault.DISK_FULL, path=target, free_bytes=free_bytes)


def _check_whole(partial: Path, target: Path, frames: int) -> None:
    reader = open_video(partial)
    found = int(reader.get(cv2.CAP_PROP_FRAME_COUNT)) if reader is not None else 0
    if found != frames:
        raise AppError(FilmFault.NOT_WHOLE, path=target, written=frames, read=found)
