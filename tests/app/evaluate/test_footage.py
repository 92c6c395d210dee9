from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from app.evaluate.footage import read_footage
from app.system.errors import AppError


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
    ("text", "complaint"),
    [
        ("", "line 1: the columns"),
        ("path,label\n", "line 1: the columns"),
        ("frame,label\n", "line 2: the first label"),
        ("frame,label\n1,5\n", "line 2: the first label"),
        ("frame,label\n0,5\n-4,skip\n", "line 3: a frame's number"),
        ("frame,label\n0,5\n4\n", "line 3: a frame's number"),
        ("frame,label\n0,5\n4,eleven\n", "line 3: unknown label 'eleven'"),
        ("frame,label\n0,5\n4,skip\n4,6\n", "line 4: frames must grow"),
        ("frame,label\n0,5\n4,skip\n12,6\n", "line 4: frames must grow .* before 12"),
    ],
)
def test_bad_tables_are_refused_by_line(video: Path, tmp_path: Path, text: str, complaint: str) -> None:
    table = tmp_path / "labels.csv"
    table.write_text(text)
    with pytest.raises(AppError, match=complaint):
        read_footage(video, table)


def test_what_is_no_footage_is_refused(video: Path, tmp_path: Path) -> None:
    (tmp_path / "text.mp4").write_text("no video")
    for where in (tmp_path / "missing.mp4", tmp_path / "text.mp4"):
        with pytest.raises(AppError, match="is no video that can be read"):
            read_footage(where)
    with pytest.raises(AppError, match="--labels"):
        read_footage(video, tmp_path / "missing.csv")
    with pytest.raises(AppError, match="with a video file only"):
        read_footage(tmp_path, tmp_path / "labels.csv")
