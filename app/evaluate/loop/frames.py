"""The frames that speed is measured over, decoded beforehand into a file that every process maps.

300 frames of 1280×720 are 0.8 GB: each process with a copy of its own would take that once more. The file has no name
in a folder, so that however this process ends none is left; others open it by this process's descriptor.
"""

from __future__ import annotations

import math
import mmap
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from tempfile import TemporaryFile, gettempdir

import cv2
import numpy as np

from app.evaluate.harness import FRAME_NS, EvaluateFault, writing
from app.evaluate.readings import SPEED_COLUMNS, read_frames
from app.system.errors import AppError
from hal.cameras.playback import decode_image
from kgdfa.preprocess import Image


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedFrames:
    """Frames one after the other in a file. shapes: (height, width, 3) of each. unreadable: files left out."""

    file: Path
    shapes: tuple[tuple[int, ...], ...]
    focal_px: float
    unreadable: tuple[Path, ...]

    def images(self) -> list[Image]:
        """All of them, mapped: they can't be written, and outlive the file."""
        with self.file.open("rb") as file:
            data = np.frombuffer(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ), np.uint8)
        ends = accumulate(map(math.prod, self.shapes))
        parts = np.split(data, [*ends][:-1])
        return [part.reshape(shape) for part, shape in zip(parts, self.shapes, strict=True)]


@contextmanager
def frames_for_speed(directory: Path | None, count: int) -> Iterator[SpeedFrames]:
    """At most `count` frames of a recording, or of the digital hand showing one gesture after the other.

    The file is there until the end. Raises AppError where no frame can be read or the file can't be written.
    """
    shapes, unreadable = list[tuple[int, ...]](), list[Path]()
    focal_px, images = _digital(count) if directory is None else _recorded(directory, count, unreadable)
    folder = Path(gettempdir())
    with writing(folder):
        opened = TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115  # what a full disk refuses is not tried again
    with opened as file:
        with writing(folder):
            for image in images:
                shapes.append(image.shape)
                rest = np.ascontiguousarray(image).data.cast("B")
                while rest:
                    rest = rest[file.write(rest) :]
        path = Path(f"/proc/{os.getpid()}/fd/{file.fileno()}")
        if not shapes:
            raise AppError(EvaluateFault.IMAGE_UNREADABLE, file=unreadable[0])
        yield SpeedFrames(file=path, shapes=tuple(shapes), focal_px=focal_px, unreadable=tuple(unreadable))


def _recorded(directory: Path, count: int, unreadable: list[Path]) -> tuple[float, Iterator[Image]]:
    listed = read_frames(directory, SPEED_COLUMNS)[:count]

    def images() -> Iterator[Image]:
        for frame in listed:
            image = decode_image(frame.path, cv2.IMREAD_COLOR)
            if image is None:
                unreadable.append(frame.path)
            else:
                yield np.asarray(image, np.uint8)

    return listed[0].focal_px, images()


def _digital(count: int) -> tuple[float, Iterator[Image]]:
    from hal.cameras.digital_hand.driver import DigitalHandCamera
    from hal.cameras.digital_hand.skeleton import GESTURES

    camera = DigitalHandCamera(clock_ns=lambda: 0)

    def images() -> Iterator[Image]:
        for number in range(count):
            if number % 25 == 0:
                camera.command(gesture=GESTURES[number // 25 % len(GESTURES)].name, at_ns=number * FRAME_NS)
            yield camera.render((number + 1) * FRAME_NS).image_bgr

    return camera.lens.fx_px, images()
