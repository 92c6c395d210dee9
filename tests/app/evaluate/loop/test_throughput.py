"""Speed: the frames it is measured over, of a recording or of the digital hand, and which of them are counted."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import tracemalloc
from pathlib import Path
from types import SimpleNamespace, TracebackType
from typing import Any

import cv2
import numpy as np
import pytest

from app.cli.tree import command
from app.evaluate.harness import EvaluateFault
from app.evaluate.loop.frames import SpeedFrames, frames_for_speed
from app.evaluate.loop.speed import BARE, WARM_UP, WHOLE, measure_speed, worker_counts
from app.system.errors import AppError
from kgdfa.gesture import Gesture
from kgdfa.hand import Hand
from tests.kgdfa.hands import STATES, drawn_hand
from tests.support.disks import full_disk


def test_without_a_recording_the_digital_hand_moves() -> None:
    with frames_for_speed(None, 4) as made:
        images = made.images()
    assert not made.unreadable
    assert [image.shape for image in images] == [(720, 1280, 3)] * 4
    assert made.focal_px == 650.0
    assert (images[0] != images[3]).any()


def recording(folder: Path, *, frames: int, missing: int = 0) -> None:
    """As `distance` takes it, without labels; the last `missing` of its images are not there."""
    lines = ["path,distance_cm,anchor_cm,fx,cx,cy"]
    for number in range(frames):
        if number < frames - missing:
            cv2.imwrite(str(folder / f"{number}.png"), np.full((8, 10, 3), 10 * number, np.uint8))
        lines.append(f"{number}.png,40,6.5,600,5,4")
    (folder / "frames.csv").write_text("\n".join(lines))


def test_a_recording_gives_its_first_frames_and_its_focal_length(tmp_path: Path) -> None:
    recording(tmp_path, frames=3)
    with frames_for_speed(tmp_path, 2) as made:
        images = made.images()
    assert [int(image[0, 0, 0]) for image in images] == [0, 10]
    assert (made.focal_px, made.unreadable) == (600.0, ())
    assert not made.file.exists()


def test_the_frames_have_no_name_that_could_be_left_and_another_process_maps_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording(tmp_path, frames=3)
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(scratch))
    with frames_for_speed(tmp_path, 3) as made:
        assert [*scratch.iterdir()] == []
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            levels = pool.apply(levels_of, (made,))
    assert levels == [0, 10, 20]


def levels_of(made: SpeedFrames) -> list[int]:
    return [int(image[0, 0, 0]) for image in made.images()]


# A pool whose process writes that it has begun work, which never ends.
WAITING = """
import os, signal, sys
from app.evaluate.harness import process_pool
def work():
    os.write(1, b"begun")
    signal.pause()
if __name__ == "__main__":
    with process_pool(1, os.getpid) as pool:
        pool.submit(work).result()
"""


def test_a_pool_ends_with_its_parent_however_that_ends(tmp_path: Path) -> None:
    (tmp_path / "waiting.py").write_text(WAITING)
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[4])}
    with subprocess.Popen(
        [sys.executable, "waiting.py"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, cwd=tmp_path, env=environment
    ) as process:
        assert process.stdout is not None
        assert process.stdout.read(5) == b"begun"
        process.kill()
        rest, _ = process.communicate(timeout=60)  # until nobody holds its stdout
    assert rest == b""


# An evaluation that is told to end while it works, and once more while it ends.
TOLD = """
import os, signal, sys
from app.cli import main
from app.cli.evaluate import keypoints
def read(_):
    try:
        os.kill(os.getpid(), signal.SIGTERM)
        signal.pause()
    finally:
        os.kill(os.getpid(), signal.SIGTERM)
        print("work is kept", flush=True)
keypoints.read_labels = read
main()
"""


def test_sigterm_ends_an_evaluation_as_ctrl_c_does(tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[4])}
    line = [sys.executable, "-c", TOLD, "evaluate", "gestures", str(tmp_path)]
    done = subprocess.run(line, capture_output=True, text=True, env=environment, timeout=60, check=False)
    assert (done.returncode, done.stdout.splitlines()[0]) == (130, "work is kept")


def test_a_command_leaves_sigterm_as_it_was(tmp_path: Path) -> None:
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(AppError):
        command().main(["evaluate", "gestures", str(tmp_path)], standalone_mode=False)
    assert signal.getsignal(signal.SIGTERM) is before


def test_frames_that_can_not_be_read_are_left_out_and_named(tmp_path: Path) -> None:
    recording(tmp_path, frames=3, missing=1)
    with frames_for_speed(tmp_path, 3) as made:
        assert (len(made.images()), made.unreadable) == (2, (tmp_path / "2.png",))


def test_frames_of_other_sizes_are_told_apart(tmp_path: Path) -> None:
    recording(tmp_path, frames=3)
    cv2.imwrite(str(tmp_path / "1.png"), np.full((5, 4, 3), 77, np.uint8))
    with frames_for_speed(tmp_path, 3) as made:
        images = made.images()
    assert [image.shape for image in images] == [(8, 10, 3), (5, 4, 3), (8, 10, 3)]
    assert [set(image.ravel()) for image in images] == [{0}, {77}, {20}]


def test_all_processes_map_one_copy_of_the_frames(tmp_path: Path) -> None:
    recording(tmp_path, frames=25)
    for number in range(25):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((400, 400, 3), number, np.uint8))
    tracemalloc.start()
    try:
        with frames_for_speed(tmp_path, 25) as made:
            images, of_another = made.images(), made.images()
        assert tracemalloc.get_traced_memory()[0] < images[0].nbytes, "held"
    finally:
        tracemalloc.stop()
    assert not any(image.flags.writeable for image in images)
    assert [int(image[0, 0, 0]) for image in of_another] == [*range(25)]


def test_a_disk_without_room_for_the_frames_is_named(tmp_path: Path) -> None:
    recording(tmp_path, frames=3)
    with full_disk(100), pytest.raises(AppError) as refused, frames_for_speed(tmp_path, 3):
        pass
    assert refused.value.code is EvaluateFault.FILE_UNWRITABLE


def test_a_recording_without_one_readable_frame_is_refused(tmp_path: Path) -> None:
    recording(tmp_path, frames=2, missing=2)
    with pytest.raises(AppError, match="IMAGE_UNREADABLE"), frames_for_speed(tmp_path, 2):
        pass


class Finder:
    """A detector that finds one hand in every image."""

    def __init__(self, *_: object) -> None:
        self._hand = drawn_hand(STATES[Gesture.FIVE])

    def __enter__(self) -> Finder:
        return self

    def __exit__(self, _kind: type | None, _error: BaseException | None, _trace: TracebackType | None) -> None:
        """Nothing is held."""

    def detect(self, _image: Any, _captured_ns: int = 0) -> tuple[Hand, ...]:
        return (self._hand,)

    def infer(self, _image: Any, _captured_ns: int = 0) -> SimpleNamespace:
        return SimpleNamespace(hand_landmarks=[self._hand])

    def follow(self, _hand: Hand | None, _unknown: bool, _sought: object) -> None:
        """There is one only."""


@pytest.mark.parametrize("frames", [3, WARM_UP, WARM_UP + 2])
def test_frames_to_warm_up_count_in_no_figure(frames: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("kgdfa.keypoints.HandDetector", Finder)
    monkeypatch.setattr("kgdfa.keypoints.live_detector", Finder)
    monkeypatch.setattr("app.evaluate.loop.speed.bundle_sizes", lambda _: {})
    monkeypatch.setattr("app.evaluate.loop.speed.gc_freeze", lambda: None)
    figures = measure_speed([np.zeros((72, 128, 3), np.uint8)] * frames, Path(), focal_px=600.0)
    assert (figures.frames, figures.hands) == (frames, frames)
    assert [figures.detectors[name].hands for name in (WHOLE, BARE)] == [frames, frames]


def test_a_recording_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(AppError, match="FILE_UNREADABLE"), frames_for_speed(tmp_path, 2):
        pass


@pytest.mark.parametrize(("workers", "counts"), [(0, []), (1, [1]), (2, [1, 2]), (8, [1, 8])])
def test_one_process_is_timed_beside_as_many_as_asked(workers: int, counts: list[int]) -> None:
    assert worker_counts(workers) == counts


def test_unless_configured_otherwise_every_core_has_a_process() -> None:
    assert worker_counts(None) == sorted({1, len(os.sched_getaffinity(0))})
