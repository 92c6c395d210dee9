"""The perception process: when it says that recognition runs, and what it begins anew."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from msgspec import structs

from app.ipc.links import Address, new_link_directory
from app.ipc.messages import TriggerReport
from app.perception import pipeline, process
from app.perception.camera import PerceptionNote
from app.perception.process import Perception
from app.system.config import CameraConfig, Config, SessionSetup
from hal.cameras.camera import Frame
from hal.errors import CameraFault, HardwareError
from kgdfa.button_state import STALE_NS, ButtonPlace, ButtonState
from kgdfa.errors import KgdfaFault
from kgdfa.hand import Hand, Side
from kgdfa.pipeline import PipelineInput, Report
from logs.reason import key_of, reason
from logs.records import Camera, EventRaised, ProcessEnd
from profiles.palm import reference_segment, with_calibration
from profiles.schema import DEMO_PATIENT, Calibration

PATIENCE_S = 30.0


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


class Held:
    """A pipeline of ours that has a hand at the button in every frame."""

    def process(self, source: PipelineInput) -> Report:
        image_px = np.random.default_rng(1).uniform(100.0, 200.0, (21, 2))
        return Report(
            captured_ns=source.captured_ns,
            hand=Hand(image_px=image_px, world_m=np.zeros((21, 3)), presence=0.9, side=Side.RIGHT),
            verdict=None,
            gesture=None,
            recognised_ns=0,
            votes=0,
            distance=None,
            depth_distance=None,
            button=ButtonState(pressed=True, cancel_count=2),
        )


@pytest.mark.parametrize(
    ("captured_in_ns", "unplugged", "held"),
    [(3_600_000_000_000, False, True), (-STALE_NS, False, False), (3_600_000_000_000, True, False)],
    ids=["between two frames", "paused", "lost"],
)
def test_between_two_frames_of_a_slow_camera_a_hand_stays_as_it_was(
    made: Perception, monkeypatch: pytest.MonkeyPatch, captured_in_ns: int, unplugged: bool, held: bool
) -> None:
    """Every second read gives nothing. A capture time an hour ahead is recent for as long as the test may take."""
    place = ButtonPlace.in_the_middle(640, 360, 0.2)
    monkeypatch.setattr(pipeline, "make_pipeline", lambda *_: (Held(), place))
    camera, sent = made._camera.camera, list[TriggerReport]()
    read, between = camera.read, list[int]()

    def slow(timeout_s: float) -> Frame | None:
        if sent and sent[-1].detector_ready and sent[-1].hand and not between:
            between.append(len(sent))
            if unplugged:
                raise HardwareError(CameraFault.UNPLUGGED, camera="digital")
            return None
        frame = read(timeout_s)
        return None if frame is None else replace(frame, captured_ns=time.monotonic_ns() + captured_in_ns)

    def take(message: TriggerReport) -> None:
        sent.append(message)
        if between or len(sent) > 1000:
            made.end()

    monkeypatch.setattr(camera, "read", slow)
    Publisher.take = take
    made.run()
    made.close()
    before, after = sent[-2:]
    assert between == [len(sent) - 1]
    assert (before.hand, before.pressed) == (True, True)
    assert (after.hand, after.pressed, after.cancel_count) == (held, held, 2)
    assert (after.captured_ns, after.sequence) == (before.captured_ns, before.sequence + 1)


def test_a_palm_that_the_lens_makes_none_is_a_lasting_hint_and_no_end(made: Perception) -> None:
    camera, sent = made._camera.camera.name, list[TriggerReport]()
    calibration = Calibration(
        camera=camera, focal_anchor_px_m=1.0, focal_px=20.0, distance_m=0.3, residual=0.01, calibrated_at="2026",
        width_px=640, height_px=360,
    )  # fmt: skip
    made._setup = structs.replace(made._setup, profile=with_calibration(DEMO_PATIENT, calibration))

    def take(message: TriggerReport) -> None:
        sent.append(message)
        if (message.detector_ready and len({one.captured_ns for one in sent}) > 5) or len(sent) > 1000:
            made.end()

    Publisher.take = take
    made.run()
    made.close()
    for one in sent[-4:]:
        assert one.hint is not None
        assert (one.hint.code, one.hand) == (key_of(KgdfaFault.REFERENCE_LENGTH), False)
    assert sent[-1].detector_ready, "a model that is loaded is not starting"
    assert DETECTOR.frames == 0
    assert [one.text for one in Sink.records if isinstance(one, EventRaised)] == [sent[-1].hint]


@pytest.mark.parametrize(
    ("width_px", "height_px", "unused"), [(640, 480, True), (640, 360, False), (640, 0, False), (1280, 0, True)]
)
def test_a_calibration_on_images_of_another_shape_is_a_lasting_hint(
    made: Perception, width_px: int, height_px: int, unused: bool
) -> None:
    camera = made._camera.camera
    frame = made._camera.read(0.0, PATIENCE_S)
    made.close()
    assert frame is not None
    focal_px = frame.intrinsics.fx_px
    calibration = Calibration(
        camera=camera.name, focal_anchor_px_m=focal_px * reference_segment(DEMO_PATIENT).length_m, focal_px=focal_px,
        distance_m=0.3, residual=0.01, calibrated_at="2026", width_px=width_px, height_px=height_px,
    )  # fmt: skip
    setup = structs.replace(made._setup, profile=with_calibration(DEMO_PATIENT, calibration))
    hint = pipeline.lasting_hint(setup, pipeline.zone_for(setup, frame, camera.name), frame, camera.name)
    assert hint == (reason(PerceptionNote.CALIBRATION_UNUSED, camera=camera.name) if unused else None)


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
