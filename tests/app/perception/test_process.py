"""The perception process: when it says that recognition runs, and what it begins anew."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import pytest

from app.ipc.links import Address, new_link_directory
from app.ipc.messages import TriggerReport
from app.perception import pipeline, process
from app.perception.process import Perception
from app.system.config import CameraConfig, Config, SessionSetup
from hal.cameras.camera import Frame
from hal.errors import CameraFault, HardwareError
from logs.records import Camera, ProcessEnd
from profiles.schema import DEMO_PATIENT


class NoHands:
    """A detector that finds nothing, and counts its frames."""

    def __init__(self) -> None:
        self.frames = 0

    def detect(self, _image: object, _captured_ns: int) -> tuple[()]:
        self.frames += 1
        return ()

    def follow(self, _hand: object, _unknown: bool, _sought: object) -> None:
        """Nothing is tracked."""

    def close(self) -> None:
        """Nothing is open."""


DETECTOR = NoHands()


class Sink:
    """Takes every record."""

    records: ClassVar[list[object]] = []

    def __init__(self, *_: object) -> None:
        pass

    def emit(self, body: object) -> bool:
        type(self).records.append(body)
        return True

    def close(self) -> None:
        """Nothing is open."""


class Publisher:
    """Hands every report on to the test."""

    take: ClassVar[Callable[[TriggerReport], None]]

    def __init__(self, _at: Address) -> None:
        pass

    def send(self, message: object) -> None:
        if isinstance(message, TriggerReport):
            type(self).take(message)

    def foreign_peers(self) -> int:
        return 0

    def close(self) -> None:
        """Nothing is open."""


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Perception:
    """A perception of a digital hand, in which no hand is found."""
    monkeypatch.setattr(process, "Publisher", Publisher)
    monkeypatch.setattr(process, "AuditSink", Sink)
    monkeypatch.setattr(process, "gc_freeze", lambda: None)
    monkeypatch.setattr(pipeline, "make_detector", lambda _: DETECTOR)
    Sink.records, DETECTOR.frames = [], 0
    (tmp_path / "links").mkdir()
    return Perception(
        SessionSetup(
            session="s",
            home=tmp_path,
            links=new_link_directory(tmp_path / "links"),
            config=Config(camera=CameraConfig(width_px=640, height_px=360)),
            profile=DEMO_PATIENT,
            operator="ann",
            host_pid=os.getppid(),
        )
    )


def test_the_frame_in_which_the_pipeline_is_built_still_counts_as_loading(made: Perception) -> None:
    sent = list[tuple[int, bool]]()

    def take(message: TriggerReport) -> None:
        sent.append((DETECTOR.frames, message.detector_ready))
        if message.detector_ready or len(sent) > 1000:
            made.end()

    Publisher.take = take
    made.run()
    made.close()
    assert sent[-2:] == [(1, False), (2, True)]


@pytest.mark.parametrize(
    ("width_px", "name", "anew"), [(640, "built in", False), (1280, "built in", True), (1280, "on a cable", True)]
)
def test_a_camera_that_comes_back_with_another_image_size_begins_anew(
    made: Perception, monkeypatch: pytest.MonkeyPatch, width_px: int, name: str, anew: bool
) -> None:
    sent = list[TriggerReport]()
    camera = made._camera.camera
    monkeypatch.setattr(type(camera), "name", property(lambda _: name if lost else "built in"))
    read, lost = camera.read, list[bool]()

    def resized(timeout_s: float) -> Frame | None:
        frame = read(timeout_s)
        if frame is None or not lost:
            return frame
        lens = replace(frame.intrinsics, width_px=width_px, height_px=width_px * 9 // 16)
        return replace(frame, intrinsics=lens)

    def unplugged_once(timeout_s: float) -> Frame | None:
        if sent and sent[-1].detector_ready and not lost:
            lost.append(True)
            raise HardwareError(CameraFault.UNPLUGGED, camera="digital")
        return resized(timeout_s)

    def take(message: TriggerReport) -> None:
        sent.append(message)
        if (lost and message.detector_ready and not message.camera_fault) or len(sent) > 1000:
            made.end()

    monkeypatch.setattr(camera, "read", unplugged_once)
    Publisher.take = take
    made.run()
    made.close()
    assert lost
    assert (sent[-1].incarnation > sent[0].incarnation) is anew
    assert [one.sequence for one in sent] == list(range(1, len(sent) + 1))
    cameras = [(one.camera, one.width_px) for one in Sink.records if isinstance(one, Camera)]
    assert cameras[-1] == (name, width_px)
    assert set(cameras) == {("built in", 640), (name, width_px)}


def test_a_detector_that_can_not_be_built_still_ends_in_order(
    made: Perception, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(_: object) -> NoHands:
        raise HardwareError(CameraFault.UNPLUGGED, camera="model")

    monkeypatch.setattr(pipeline, "make_detector", broken)
    Publisher.take = lambda _: None
    with pytest.raises(HardwareError):
        made.run()
    made.close()
    assert isinstance(Sink.records[-1], ProcessEnd)
