from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from app.evaluate.harness import EvaluateFault
from app.evaluate.readings import DISTANCE_COLUMNS, GESTURE_COLUMNS, read_footage, read_frames
from app.system.errors import AppError
from app.text.catalogue import render


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve frames of 64×48 at 20 a second, each lighter than the last."""
    file = tmp_path_factory.mktemp("footage") / "hand.avi"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 20.0, (64, 48))
    for number in range(12):
        writer.write(np.full((48, 64, 3), 20 * number, np.uint8))
    writer.release()
    return file


def test_a_video_has_a_label_for_every_frame(video: Path, tmp_path: Path) -> None:
    table = tmp_path / "labels.csv"
    table.write_text("frame,label\n0,skip\n3,5\n10,none:rest\n")
    footage = read_footage(video, table)
    assert footage.labels == ("skip",) * 3 + ("5",) * 7 + ("none:rest",) * 2
    assert footage.period_ns == 50_000_000
    assert footage.focal_px == pytest.approx(47.5)
    for _ in range(2):
        lightness = [image.mean() for image in footage.frames()]
        assert lightness == pytest.approx([20 * number for number in range(12)], abs=6)


def test_the_table_beside_the_video_is_its_own(video: Path) -> None:
    video.with_suffix(".csv").write_text("frame,label\n0,love\n")
    assert read_footage(video).labels == ("love",) * 12


@pytest.mark.parametrize(
    ("text", "fault", "line"),
    [
        ("", EvaluateFault.TABLE_COLUMNS, None),
        ("path,label\n", EvaluateFault.TABLE_COLUMNS, None),
        ("frame,label\n", EvaluateFault.VIDEO_START, None),
        ("frame,label\n1,5\n", EvaluateFault.VIDEO_START, None),
        ("frame,label\n0,5\n-4,skip\n", EvaluateFault.VIDEO_ROW, 3),
        ("frame,label\n0,5\n4\n", EvaluateFault.ROW_FIELDS, 3),
        ("frame,label\n0,5\n4,eleven\n", EvaluateFault.ROW_LABEL, 3),
        ("frame,label\n0,5\n4,skip\n4,6\n", EvaluateFault.VIDEO_ORDER, 4),
        ("frame,label\n0,5\n4,skip\n12,6\n", EvaluateFault.VIDEO_ORDER, 4),
    ],
)
def test_bad_tables_are_refused_by_line(
    video: Path, tmp_path: Path, text: str, fault: EvaluateFault, line: int | None
) -> None:
    table = tmp_path / "labels.csv"
    table.write_text(text)
    with pytest.raises(AppError) as caught:
        read_footage(video, table)
    assert (caught.value.code, caught.value.values.get("line")) == (fault, line)
    assert str(table) in render(caught.value)


def test_what_is_no_footage_is_refused(video: Path, tmp_path: Path) -> None:
    (tmp_path / "text.mp4").write_text("no video")
    refused = [
        (tmp_path / "missing.mp4", None, EvaluateFault.VIDEO_UNREADABLE),
        (tmp_path / "text.mp4", None, EvaluateFault.VIDEO_UNREADABLE),
        (video, tmp_path / "missing.csv", EvaluateFault.FILE_UNREADABLE),
        (tmp_path, tmp_path / "labels.csv", EvaluateFault.LABELS_OPTION),
    ]
    for where, labels, fault in refused:
        with pytest.raises(AppError) as caught:
            read_footage(where, labels)
        assert caught.value.code is fault


HEADER = "path,label,distance_cm,anchor_cm,fx,fy,cx,cy\n"


@pytest.mark.parametrize(
    ("text", "columns", "fault", "line"),
    [
        (HEADER, GESTURE_COLUMNS, EvaluateFault.TABLE_EMPTY, None),
        (HEADER + "a.jpg,1,40,6.7,wide,900,1,1\n", GESTURE_COLUMNS, EvaluateFault.ROW_NUMBER, 2),
        (
            HEADER + "a.jpg,1,40,6.7,900,900,1,1\nb.jpg,ten,40,6.7,900,900,1,1\n",
            GESTURE_COLUMNS,
            EvaluateFault.ROW_LABEL,
            3,
        ),
        ("path,label\na.jpg,1\n", GESTURE_COLUMNS, EvaluateFault.TABLE_COLUMNS, None),
        (HEADER + "a.jpg,1,0,6.7,900,900,1,1\n", DISTANCE_COLUMNS, EvaluateFault.ROW_DISTANCE, 2),
        (HEADER + "a.jpg,1,nan,6.7,900,900,1,1\n", DISTANCE_COLUMNS, EvaluateFault.ROW_DISTANCE, 2),
    ],
)
def test_bad_frame_lists_are_refused_by_line(
    tmp_path: Path, text: str, columns: tuple[str, ...], fault: EvaluateFault, line: int | None
) -> None:
    (tmp_path / "frames.csv").write_text(text)
    with pytest.raises(AppError) as caught:
        read_frames(tmp_path, columns)
    assert (caught.value.code, caught.value.values.get("line")) == (fault, line)


def test_one_reader_gives_labels_and_distances_whichever_are_required(tmp_path: Path) -> None:
    (tmp_path / "frames.csv").write_text(HEADER + "a.jpg,love,40,6.7,900,901,640,360\n")
    (labelled,) = read_frames(tmp_path)
    assert (labelled.label, labelled.reference_m, labelled.focal_px) == ("love", 0.067, 900.0)
    (measured,) = read_frames(tmp_path, DISTANCE_COLUMNS)
    assert (measured.distance_m, measured.centre_px) == (0.40, (640.0, 360.0))
