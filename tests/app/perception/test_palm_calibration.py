from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest

from app.perception.palm_calibration import WANTED_SAMPLES, PalmHint, PalmSampler, sample_palm
from app.system.errors import AppError
from hal.cameras.camera import EndOfRecording, Frame, Intrinsics, IntrinsicsSource
from kgdfa.hand import Hand, Side
from kgdfa.palm_shape import RIGID, SHAPE
from kgdfa.preprocess import Image
from kgdfa.robust_distance import RobustRange
from profiles.errors import ProfileError
from profiles.schema import Profile, Sex

LENS = Intrinsics(
    width_px=1280, height_px=720, fx_px=900, fy_px=900, cx_px=640, cy_px=360, source=IntrinsicsSource.GIVEN
)
TRUE_REFERENCE_M, TRUE_M = 0.065, 0.30
AT = datetime(2026, 3, 1, tzinfo=UTC)


@pytest.fixture
def patient() -> Profile:
    return Profile(identifier="P-0042", sex=Sex.MALE, stature_m=1.756, mass_kg=81.5)


def palm(
    yaw_rad: float = 0.0, lens: Intrinsics = LENS, *, reference_m: float = TRUE_REFERENCE_M, distance_m: float = TRUE_M
) -> Hand:
    """A flat palm, exactly seen."""
    flat = np.zeros((21, 3))
    flat[list(RIGID), :2] = SHAPE * reference_m
    flat = flat * (np.cos(yaw_rad), 1, 1)
    image_px = flat[:, :2] / distance_m * lens.fx_px + (lens.cx_px, lens.cy_px)
    return Hand(image_px=image_px, world_m=flat, presence=1, side=Side.RIGHT)


class Shown:
    """A detector of ours that is told what it sees."""

    def __init__(self, *hands: Hand) -> None:
        self.hands = hands

    def detect(self, image_bgr: Image, captured_ns: int) -> tuple[Hand, ...]:
        return self.hands


class Frames:
    """A camera of ours with a number of grey images in it."""

    name = "grey"

    def __init__(self, count: int, silent: dict[int, int] | None = None) -> None:
        """silent: reads without an image, by how many images are left then."""
        self.left = count
        self.silent = silent or {}

    def open(self) -> None: ...
    def close(self) -> None: ...

    def read(self, timeout_s: float) -> Frame | None:
        if not self.left:
            return None
        if self.silent.get(self.left):
            self.silent[self.left] -= 1
            return None
        self.left -= 1
        grey = np.full((720, 1280, 3), 128, np.uint8)
        return Frame(image_bgr=grey, captured_ns=(1000 - self.left) * 33_000_000, sequence=0, intrinsics=LENS)


def test_a_palm_held_still_is_calibrated(patient: Profile) -> None:
    sampler = sample_palm(patient, Frames(500), Shown(palm()), lambda *_: None)
    assert len(sampler.samples_m) == WANTED_SAMPLES
    made = sampler.solve("grey", TRUE_M, AT)
    assert made.reference_m == pytest.approx(TRUE_REFERENCE_M, rel=0.02)
    assert (made.calibration.width_px, made.calibration.height_px) == (1280, 720)
    assert not made.doubt


@pytest.mark.parametrize("reference_m", [0.050, 0.065, 0.080])
@pytest.mark.parametrize("distance_m", [0.15, 0.30, 0.80])
def test_after_a_calibration_the_palm_reads_right_where_it_was_held(
    patient: Profile, reference_m: float, distance_m: float
) -> None:
    held = palm(reference_m=reference_m, distance_m=distance_m)
    made = sample_palm(patient, Frames(500), Shown(held), lambda *_: None).solve("grey", distance_m, AT)
    finder = RobustRange(focal_px=LENS.fx_px, reference_m=made.reference_m, centre_px=(LENS.cx_px, LENS.cy_px))
    read = finder.measure(held, 1)
    assert read is not None
    assert read.shown_m == pytest.approx(distance_m, rel=1e-6)


@pytest.mark.parametrize(
    ("hands", "hint"),
    [
        ((), PalmHint.SHOW_ONE_HAND),
        ((palm(), palm()), PalmHint.SHOW_ONE_HAND),
        ((palm(yaw_rad=0.9),), PalmHint.FACE_CAMERA),
    ],
)
def test_what_is_no_palm_before_the_camera_is_no_sample_and_helped(
    patient: Profile, hands: tuple[Hand, ...], hint: PalmHint
) -> None:
    hints: list[PalmHint] = []
    sampler = sample_palm(patient, Frames(400), Shown(*hands), lambda now, _: hints.append(now.hint))
    assert sampler.samples_m == []
    assert hints[-1] is hint
    with pytest.raises(ProfileError, match="TOO_FEW_SAMPLES count=0"):
        sampler.solve("grey", TRUE_M, AT)


class Recording(Frames):
    """A camera of ours that has no more images after its last one."""

    def read(self, timeout_s: float) -> Frame | None:
        if not self.left:
            raise EndOfRecording
        return super().read(timeout_s)


def test_a_recording_that_ends_is_solved_with_what_it_showed(patient: Profile) -> None:
    enough = sample_palm(patient, Recording(40), Shown(palm()), lambda *_: None)
    assert enough.solve("grey", TRUE_M, AT).reference_m == pytest.approx(TRUE_REFERENCE_M, rel=0.02)
    short = sample_palm(patient, Recording(3), Shown(palm()), lambda *_: None)
    with pytest.raises(ProfileError, match="TOO_FEW_SAMPLES count=3"):
        short.solve("grey", TRUE_M, AT)


def test_another_resolution_starts_anew(patient: Profile) -> None:
    sampler = PalmSampler(patient, Shown(palm()), [])
    frame = Frames(1).read(0.1)
    assert frame is not None
    sampler.take(frame)
    small = Intrinsics(
        width_px=640, height_px=360, fx_px=450, fy_px=450, cx_px=320, cy_px=180, source=IntrinsicsSource.GIVEN
    )
    sampler.detector = Shown(palm(lens=small))
    sampler.take(Frame(image_bgr=frame.image_bgr, captured_ns=99, sequence=1, intrinsics=small))
    assert len(sampler.samples_m) == 1


def test_a_camera_without_images_is_reported(patient: Profile) -> None:
    with pytest.raises(AppError, match="NO_FRAME camera=grey"):
        sample_palm(patient, Frames(3), Shown(palm()), lambda *_: None)


def test_a_camera_that_is_slow_to_start_is_waited_for(patient: Profile) -> None:
    """Reads of half a second: ten seconds for the first image, two for each later one."""
    slow = Frames(500, {500: 19, 490: 3})
    assert len(sample_palm(patient, slow, Shown(palm()), lambda *_: None).samples_m) == WANTED_SAMPLES
    for silent in ({500: 20}, {490: 4}):
        with pytest.raises(AppError, match="NO_FRAME camera=grey"):
            sample_palm(patient, Frames(500, silent), Shown(palm()), lambda *_: None)
