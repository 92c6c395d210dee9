"""The frames that speed is measured over: of a recording, or of the digital hand."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from app.evaluate.loop.speed import frames_for_speed, worker_counts
from app.system.errors import AppError


def test_without_a_recording_the_digital_hand_moves() -> None:
    images, focal_px = frames_for_speed(None, 4)
    assert [image.shape for image in images] == [(720, 1280, 3)] * 4
    assert focal_px == 650.0
    assert (images[0] != images[3]).any()


def test_a_recording_gives_its_first_frames_and_its_focal_length(tmp_path: Path) -> None:
    lines = ["path,label,anchor_cm,fx"]
    for number in range(3):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((8, 10, 3), 10 * number, np.uint8))
        lines.append(f"{number}.png,5,6.5,600")
    (tmp_path / "frames.csv").write_text("\n".join(lines))
    images, focal_px = frames_for_speed(tmp_path, 2)
    assert [int(image[0, 0, 0]) for image in images] == [0, 10]
    assert focal_px == 600.0


def test_a_recording_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(AppError, match="FILE_UNREADABLE"):
        frames_for_speed(tmp_path, 2)


@pytest.mark.parametrize(("workers", "counts"), [(0, []), (1, [1]), (2, [1, 2]), (8, [1, 8])])
def test_one_process_is_timed_beside_as_many_as_asked(workers: int, counts: list[int]) -> None:
    assert worker_counts(workers) == counts


def test_unless_configured_otherwise_every_core_has_a_process() -> None:
    assert worker_counts(None) == sorted({1, len(os.sched_getaffinity(0))})
