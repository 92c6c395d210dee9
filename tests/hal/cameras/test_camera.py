"""A driver that hangs, ends or fails blocks nothing else."""

from __future__ import annotations

import queue
import threading
from contextlib import nullcontext

import pytest

from hal.cameras import camera
from hal.cameras.camera import EndOfRecording, LatestFrame
from hal.errors import CameraFault, HardwareError
from tests.support.errors import refused

LOST = HardwareError(CameraFault.NO_FRAMES, camera="cam")


def test_the_newest_value_is_given_once() -> None:
    values: queue.Queue[int] = queue.Queue()
    taken = threading.Event()

    def grab() -> int | None:
        value = values.get(timeout=10)
        if value == 3:
            taken.set()
        return value

    newest = LatestFrame(grab, lost=LOST)
    for value in (1, 2, 3):
        values.put(value)
    assert taken.wait(10)
    observed: list[int] = []
    while not observed or observed[-1] != 3:
        got = newest.take(1.0)
        if got is not None:
            observed.append(got)
    assert observed == sorted(set(observed))
    assert newest.take(0.0) is None
    values.put(4)
    newest.stop()


def test_a_driver_that_hangs_is_reported_and_abandoned() -> None:
    release, values = threading.Event(), [1]

    def hang() -> int | None:
        return values.pop() if values else release.wait(30) or None

    newest = LatestFrame(hang, lost=LOST, silence_s=0.05)
    assert newest.take(10.0) == 1
    with refused(CameraFault.NO_FRAMES, camera="cam"):
        newest.take(0.5)
    assert newest.stop() is False
    release.set()


class Clock:
    """Stands in for the module `time` of a process that stands still at will."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def monotonic(self) -> float:
        return self.now_s


def test_a_pause_of_the_whole_process_is_no_silence_of_the_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its thread stood still as well: a camera that works had been closed and opened anew."""
    monkeypatch.setattr(camera, "time", clock := Clock())
    release, values = threading.Event(), [1]
    newest = LatestFrame(lambda: values.pop() if values else release.wait(30) or None, lost=LOST)
    assert newest.take(10.0) == 1
    try:
        clock.now_s += 10.0
        assert newest.take(0.0) is None
        asked_s = clock.now_s
        with refused(CameraFault.NO_FRAMES, camera="cam"):
            while clock.now_s < asked_s + 2 * camera.SILENCE_S:
                clock.now_s += 0.1
                newest.take(0.0)
        assert clock.now_s - asked_s == pytest.approx(camera.SILENCE_S - camera.AWAY_S, abs=0.15)
    finally:
        release.set()
        newest.stop()


def test_the_first_value_may_take_longer_than_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    release, waiting = threading.Event(), []
    for first_s, lost in ((60.0, False), (0.0, True)):
        monkeypatch.setattr(camera, "FIRST_FRAME_S", first_s)
        newest = LatestFrame(lambda: release.wait(30) or None, lost=LOST, silence_s=0.0)
        with refused(CameraFault.NO_FRAMES, camera="cam") if lost else nullcontext():
            assert newest.take(0.01) is None
        waiting.append(newest)
    release.set()
    for newest in waiting:
        newest.stop()


@pytest.mark.parametrize("error", [HardwareError(CameraFault.UNPLUGGED, camera="cam"), EndOfRecording()])
def test_what_the_driver_raises_reaches_the_reader_every_time(error: Exception) -> None:
    def grab() -> int | None:
        raise error

    newest = LatestFrame(grab, lost=LOST)
    for _ in range(2):
        with pytest.raises(type(error)) as caught:
            newest.take(10.0)
        assert caught.value is error
    assert newest.stop()
