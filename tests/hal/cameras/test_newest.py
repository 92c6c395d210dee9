"""A driver that hangs, ends or dies harms nobody but itself."""

from __future__ import annotations

import queue
import threading

import pytest

from hal.cameras.camera import EndOfRecording, Newest
from hal.errors import HardwareError


def test_the_newest_value_is_given_once() -> None:
    values: queue.Queue[int] = queue.Queue()
    taken = threading.Event()

    def grab() -> int | None:
        value = values.get(timeout=10)
        if value == 3:
            taken.set()
        return value

    newest = Newest(grab, lost="gone")
    for value in (1, 2, 3):
        values.put(value)
    assert taken.wait(10)
    seen: list[int] = []
    while not seen or seen[-1] != 3:
        got = newest.take(1.0)
        if got is not None:
            seen.append(got)
    assert seen == sorted(set(seen))
    assert newest.take(0.0) is None
    values.put(4)
    newest.stop()


def test_a_driver_that_hangs_is_told_and_left_behind() -> None:
    release = threading.Event()

    def hang() -> None:
        release.wait(30)

    newest: Newest[int] = Newest(hang, lost="The camera is silent: unplug it.", silence_s=0.05)
    with pytest.raises(HardwareError, match="silent"):
        newest.take(0.5)
    assert newest.stop() is False
    release.set()


@pytest.mark.parametrize("error", [HardwareError("unplugged"), EndOfRecording("over")])
def test_what_the_driver_raises_reaches_the_reader_every_time(error: Exception) -> None:
    def grab() -> int | None:
        raise error

    newest = Newest(grab, lost="gone")
    for _ in range(2):
        with pytest.raises(type(error), match=str(error)):
            newest.take(10.0)
    assert newest.stop()
