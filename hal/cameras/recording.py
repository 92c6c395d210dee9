"""Recorded sessions: a folder of JPEG images, 16-bit depth maps in millimetres, and an index of JSON Lines.

The index is written line by line and ends with an end line; without it the recording was cut off, and
what is there is still played.
"""

from __future__ import annotations

import json
import queue
import threading
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import IO, Any

import cv2
import numpy as np

from hal.cameras.camera import DepthArray, EndOfRecording, Frame, Intrinsics, IntrinsicsSource
from hal.cameras.intrinsics import check_lens
from hal.cameras.playback import FrameSource, RecordedFrame, decode_image, read_image
from hal.errors import HardwareError, RecordingFault
from logs.reading.errors import InputError, cause_of
from logs.reading.formats import parse_json
from logs.reading.regular import read_bytes

INDEX = "frames.jsonl"
FORMAT = "rleex-recording"
VERSION = 1
MAX_INDEX = 64 << 20  # bytes; a frame has about a hundred
JPEG_QUALITY = 95
WAITING_FRAMES = 30  # a second of images may wait for the disk; later ones are dropped and counted


class Recorder:
    """Writes frames from a thread of its own, so that a slow disk never slows the chain."""

    def __init__(self, folder: Path, camera: str) -> None:
        """Make the folder. Raises HardwareError when it exists already or can't be made."""
        try:
            folder.mkdir(parents=True)
            self._index: IO[str] = (folder / INDEX).open("w", encoding="utf-8")
        except OSError as error:
            raise HardwareError(RecordingFault.UNWRITABLE, path=folder, detail=str(error)) from error
        self.folder = folder
        self.written = 0
        self.dropped = 0
        self.fault: HardwareError | None = None
        self._camera = camera
        self._pending: queue.Queue[Frame | None] = queue.Queue(WAITING_FRAMES)
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    def write(self, frame: Frame) -> bool:
        """Hand a frame over; False when the disk is behind and the frame was dropped."""
        try:
            self._pending.put_nowait(frame)
        except queue.Full:
            self.dropped += 1
            return False
        return True

    def close(self) -> None:
        self._pending.put(None)
        self._thread.join()
        if not self.fault:
            self._line({"end": True, "frames": self.written, "dropped": self.dropped})
        self._index.close()

    def _run(self) -> None:
        while (frame := self._pending.get()) is not None:
            if self.fault:
                continue
            try:
                self._save(frame)
            except (OSError, cv2.error) as error:
                self.fault = HardwareError(RecordingFault.ENDED_EARLY, path=self.folder, detail=str(error))

    def _save(self, frame: Frame) -> None:
        if self.written == 0:
            self._line(_header(frame, self._camera))
        number = f"{self.written:06d}"
        entry: dict[str, Any] = {"captured_ns": frame.captured_ns, "image": f"{number}.jpg"}
        self._encode(entry["image"], frame.image_bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        if frame.depth_m is not None:
            entry["depth"] = f"{number}.png"
            millimetres = np.clip(np.round(np.nan_to_num(frame.depth_m) * 1000), 0, 65535).astype(np.uint16)
            self._encode(entry["depth"], millimetres, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        self._line(entry)
        self.written += 1

    def _encode(self, name: str, picture: np.ndarray[Any, Any], options: list[int]) -> None:
        _, data = cv2.imencode(Path(name).suffix, picture, options)
        (self.folder / name).write_bytes(data.tobytes())

    def _line(self, entry: dict[str, Any]) -> None:
        self._index.write(json.dumps(entry) + "\n")
        self._index.flush()


def recorded_source(folder: Path) -> FrameSource:
    """What a Recorder wrote. Plays up to a cut, then ends with EndOfRecording."""

    def source() -> Iterator[RecordedFrame]:
        lines = _index_lines(folder)
        intrinsics = _intrinsics(folder, next(lines, None))
        first_ns = None
        for entry in lines:
            if entry.get("end"):
                return
            frame = _recorded_frame(folder, entry, intrinsics)
            if frame is None:
                break
            first_ns = frame.offset_ns if first_ns is None else first_ns
            yield RecordedFrame(
                offset_ns=frame.offset_ns - first_ns,
                image_bgr=frame.image_bgr,
                depth_m=frame.depth_m,
                intrinsics=intrinsics,
            )
        raise EndOfRecording(cut_off=True)

    return source


def _index_lines(folder: Path) -> Iterator[dict[str, Any]]:
    """The index's records up to the first that is not whole."""
    try:
        lines = read_bytes(folder / INDEX, MAX_INDEX).split(b"\n")
    except OSError as error:
        raise HardwareError(RecordingFault.INDEX_UNREADABLE, path=folder, detail=cause_of(error)) from error
    for line in lines:
        try:
            entry = parse_json(line)
        except InputError:
            return
        if not isinstance(entry, dict):
            return
        yield entry


def _intrinsics(folder: Path, header: dict[str, Any] | None) -> Intrinsics:
    if header is None or header.get("format") != FORMAT or header.get("version") != VERSION:
        raise HardwareError(RecordingFault.OTHER_VERSION, path=folder / INDEX)
    try:
        values = dict(header["intrinsics"])
        lens = Intrinsics(**{**values, "source": IntrinsicsSource(values["source"])})
        check_lens(lens)
        return lens
    except (KeyError, TypeError, ValueError) as error:
        raise HardwareError(RecordingFault.NO_INTRINSICS, path=folder, detail=repr(error)) from error


def _recorded_frame(folder: Path, entry: dict[str, Any], intrinsics: Intrinsics) -> RecordedFrame | None:
    """One record's images; None where the recording is cut."""
    try:
        captured_ns = int(entry["captured_ns"])
        image = read_image(folder / str(entry["image"]))
        depth = _depth(folder / str(entry["depth"])) if "depth" in entry else None
    except (KeyError, TypeError, ValueError, HardwareError):
        return None
    return RecordedFrame(offset_ns=captured_ns, image_bgr=image, depth_m=depth, intrinsics=intrinsics)


def _depth(path: Path) -> DepthArray:
    millimetres = decode_image(path, cv2.IMREAD_UNCHANGED)
    if millimetres is None or millimetres.dtype != np.uint16 or millimetres.ndim != 2:
        raise HardwareError(RecordingFault.DEPTH_UNREADABLE, path=path)
    depth_m: DepthArray = millimetres.astype(np.float32) / np.float32(1000.0)
    return depth_m


def _header(frame: Frame, camera: str) -> dict[str, Any]:
    lens = asdict(frame.intrinsics) | {"source": frame.intrinsics.source.value}
    return {"format": FORMAT, "version": VERSION, "camera": camera, "intrinsics": lens}
