"""Two cameras before one hand: what each measured, counted for each value of the ruler."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pytest

from app.perception import camera_names
from app.perception.camera_names import parse_camera, refuse_same_device
from app.perception.comparison import Comparison, comparison_record
from app.perception.look import CameraSample, LookFault, false_colours
from app.system.config import CameraConfig
from app.system.errors import AppError
from profiles.schema import DistanceUsed

FRAME_NS = 33_333_333


def sample(
    frame: int,
    distance_m: float | None,
    *,
    camera: str = "a",
    lost: int = 0,
    presses: int = 0,
    at: int | None = None,
    pressed: bool = False,
) -> CameraSample:
    """at: when it was taken, in frames of 33 ms; None: with this frame's number."""
    return CameraSample(
        camera=camera,
        captured_ns=(frame if at is None else at) * FRAME_NS,
        frames=frame,
        lost=lost,
        latency_ms=20.0,
        distance_m=distance_m,
        safe_m=distance_m,
        pressed=pressed,
        presses=presses,
    )


def test_each_value_of_the_ruler_has_a_row_of_each_camera() -> None:
    comparison = Comparison(threshold_m=0.2, ruler_m=0.30)
    for frame in range(1, 32):
        comparison.take(0, sample(frame, 0.303))
        if frame % 3 == 1:
            comparison.take(1, sample(frame // 3 + 1, 0.30 if frame % 2 else None, camera="b", lost=frame // 6))
    comparison.ruler_m = 0.15
    for frame in range(32, 40):
        comparison.take(0, sample(frame, 0.15, presses=1 if frame > 34 else 0))
    rows = list(comparison.rows())
    assert [(row.ruler_m, row.camera) for row in rows] == [(0.15, "a"), (0.30, "a"), (0.30, "b")]
    near_only, far, other = rows
    assert (far.frames, round(far.fps, 1)) == (30, 30.0)
    assert far.error == pytest.approx(0.01)
    assert far.from_other_m == pytest.approx(0.003)
    assert other.lost_share == pytest.approx(0.5)
    assert (near_only.presses[True], near_only.presses[False]) == (1, 0)
    assert comparison.total(0).frames == 38


@pytest.mark.parametrize(
    ("ruler_m", "other_m", "known"),
    [(0.25, 0.15, False), (0.18, 0.5, True), (None, 0.15, True), (None, 0.5, False), (None, None, None)],
)
def test_a_press_is_true_by_the_ruler_else_by_the_other_camera(
    ruler_m: float | None, other_m: float | None, known: bool | None
) -> None:
    comparison = Comparison(threshold_m=0.2, ruler_m=ruler_m)
    comparison.take(1, sample(1, other_m, at=2))
    comparison.take(0, sample(1, 0.21))
    comparison.take(0, sample(2, 0.19, presses=1))
    comparison.finish()
    assert comparison.total(0).presses == {True: 0, False: 0, None: 0} | {known: 1}


@pytest.mark.parametrize(
    ("ends", "seen_at", "known"), [(11, 12, True), (11, 24, True), (11, 40, None), (30, 40, True), (30, 60, False)]
)
def test_a_slow_camera_that_sees_a_push_late_makes_no_press_false(ends: int, seen_at: int, known: bool | None) -> None:
    """Frames of 33 ms: the press begins at frame 10, and the other camera sees the hand near in one frame only."""
    comparison = Comparison(threshold_m=0.2)
    for frame in range(1, 80):
        pressed = 10 <= frame <= ends
        comparison.take(0, sample(frame, 0.15, presses=1 if frame >= 10 else 0, pressed=pressed))
        if frame % 4 == 0:
            comparison.take(1, sample(frame // 4, 0.15 if frame == seen_at else 0.36, at=frame))
    assert comparison.total(0).presses == {True: 0, False: 0, None: 0} | {known: 1}


def test_a_press_nearer_than_the_other_camera_can_measure_is_unknown() -> None:
    comparison = Comparison(threshold_m=0.2)
    for frame in range(1, 60):
        pressed = 10 <= frame <= 20
        comparison.take(1, sample(frame, None if pressed else 0.36))
        comparison.take(0, sample(frame, 0.15 if pressed else 0.36, presses=int(frame >= 10), pressed=pressed))
    assert comparison.total(0).presses == {True: 0, False: 0, None: 1}


def test_two_cameras_of_one_name_are_told_apart() -> None:
    comparison = Comparison(threshold_m=0.2)
    for which in (0, 1):
        comparison.take(which, sample(1, 0.3, camera="same"))
    assert [row.camera for row in comparison.rows()] == ["same", "same (2)"]
    assert comparison_record(comparison, "x.csv").cameras == ("same", "same (2)")


def test_only_measurements_of_one_moment_are_compared() -> None:
    comparison = Comparison(threshold_m=0.2)
    for frame in range(1, 31):
        for which in (0, 1):
            comparison.take(which, sample(frame, 0.30))
    for frame in range(32, 332):  # the other camera has gone
        comparison.take(0, sample(frame, 0.60))
    assert [comparison.total(which).from_other_m for which in (0, 1)] == [0.0, 0.0]


def test_a_camera_of_long_latency_is_compared_with_what_the_other_measured_then() -> None:
    comparison = Comparison(threshold_m=0.2)
    for frame in range(1, 60):
        comparison.take(0, sample(frame, 0.30 + 0.01 * frame))
        if frame % 6 == 0:
            comparison.take(1, sample(frame // 6, 0.35 + 0.01 * (frame - 5), at=frame - 5))
    assert comparison.total(0).from_other_m == pytest.approx(-0.05)
    assert comparison.total(1).from_other_m == pytest.approx(0.05)


def test_the_table_is_written_as_csv() -> None:
    comparison = Comparison(threshold_m=0.2)
    for frame in (1, 2, 3):
        comparison.take(0, sample(frame, 0.3))
    (row,) = csv.DictReader(io.StringIO(comparison.as_csv()))
    assert (row["camera"], row["frames"], row["distance_cm"], row["ruler_cm"]) == ("a", "2", "30.0", "")


BASE = CameraConfig(kind="webcam", device="0", focal_px=900.0, mirrored=True)


@pytest.mark.parametrize(
    ("source", "expected", "used"),
    [
        ("digital-hand", ("digital-hand", "", 1, False, 30.0), DistanceUsed.MONOCULAR),
        ("digital-d435i:7@10", ("digital-hand", "", 7, True, 10.0), DistanceUsed.DEPTH),
        ("realsense@15", ("realsense", "", 1, False, 15.0), DistanceUsed.DEPTH),
        ("/data/one.bag", ("realsense", "/data/one.bag", 1, False, 30.0), DistanceUsed.DEPTH),
        ("~nobody-here/x.avi", ("recording", "~nobody-here/x.avi", 1, False, 30.0), DistanceUsed.MONOCULAR),
        ("C920", ("webcam", "C920", 1, False, 30.0), DistanceUsed.MONOCULAR),
        ("0@15", ("webcam", "0", 1, False, 15.0), DistanceUsed.MONOCULAR),
    ],
)
def test_cameras_are_named_as_people_name_them(source: str, expected: tuple[object, ...], used: DistanceUsed) -> None:
    made, found = parse_camera(source, BASE)
    assert (made.kind, made.device, made.seed, made.depth, made.rate_hz) == expected
    assert found is used
    own = (made.kind, made.device) == (BASE.kind, BASE.device)
    assert (made.focal_px, made.mirrored) == ((900.0, True) if own else (None, False)), "of one camera, not of another"


@pytest.mark.parametrize("rate", ["0", "0.05", "121", "999"])
def test_a_rate_that_no_camera_has_is_refused(rate: str) -> None:
    with pytest.raises(AppError) as refused:
        parse_camera(f"digital-hand@{rate}", BASE)
    assert refused.value.code is LookFault.RATE_OUT_OF_RANGE
    assert refused.value.values == {"rate_hz": float(rate), "least_hz": 0.1, "most_hz": 120.0}


def test_a_folder_whose_name_ends_as_a_rate_does_is_taken_as_it_is(tmp_path: Path) -> None:
    folder = tmp_path / "walk@25"
    folder.mkdir()
    made = [parse_camera(f"{folder}{rate}", BASE)[0] for rate in ("", "@10")]
    assert [(one.device, one.rate_hz) for one in made] == [(str(folder), 30.0), (str(folder), 10.0)]


def test_a_recording_keeps_its_own_lens_however_its_path_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    base = CameraConfig(kind="recording", device="~/x.avi", focal_px=900.0, mirrored=True)
    same, other = (parse_camera(f"{tmp_path}/{name}", base)[0] for name in ("x.avi", "y.avi"))
    assert (same.focal_px, same.mirrored) == (900.0, True)
    assert (other.focal_px, other.mirrored) == (None, False)


def test_two_names_of_one_device_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera_names, "_device_of", lambda _: "0")
    with pytest.raises(AppError) as refused:
        refuse_same_device(parse_camera("0", BASE)[0], parse_camera("C920", BASE)[0])
    assert refused.value.code is LookFault.SAME_DEVICE
    monkeypatch.undo()
    recording = tmp_path / "one"
    recording.mkdir()
    beside = f"{tmp_path}/../{tmp_path.name}/one"
    with pytest.raises(AppError):
        refuse_same_device(parse_camera(str(recording), BASE)[0], parse_camera(beside, BASE)[0])
    hand = parse_camera("digital-hand", BASE)[0]
    refuse_same_device(hand, hand)  # may be looked at twice
    refuse_same_device(hand, parse_camera("digital-d435i", BASE)[0])


def test_depth_in_false_colours_is_black_where_it_has_holes() -> None:
    depth = np.array([[0.0, 0.2, 1.1, np.nan, 5.0]], np.float32)
    coloured = false_colours(depth)[0].astype(int)
    assert (coloured[0] == 0).all()
    assert (coloured[3] == 0).all()
    assert coloured[1][2] > coloured[1][0], "near is red"
    assert coloured[2][0] > coloured[2][2], "far is blue"
    assert coloured[4].any()
