"""Hands that do not press, by depth with holes: progress is kept, and no clip is drawn twice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from app.evaluate.harness import EvaluateFault
from app.evaluate.trigger.idle import CLIP_FRAMES, IdleResult, IdleSettings, NoiseClip, evaluate_idle, kept_progress
from app.system.errors import AppError

SETTINGS = IdleSettings(seed=3, threshold_m=0.33, holes=0.4)
CLIPS = [
    NoiseClip(
        gesture="5",
        image=np.zeros((2, 21, 2)),
        world=np.zeros((2, 21, 3)),
        side_right=np.ones(2, bool),
        presence=np.full(2, 0.9),
    )
]


def run(before: IdleResult, clips: int, keep: Path | None = None) -> IdleResult:
    return evaluate_idle(CLIPS, before, frames=clips * CLIP_FRAMES, step=lambda _: None, keep=keep)


def test_a_run_goes_on_where_it_was_ended_and_gives_the_same(tmp_path: Path) -> None:
    path = tmp_path / "progress.json"
    run(kept_progress(path, SETTINGS), 1, path)
    went_on = run(kept_progress(path, SETTINGS), 2, path)
    assert went_on == run(IdleResult(settings=SETTINGS), 2)
    assert went_on.frames == 2 * CLIP_FRAMES
    assert 0 < went_on.depth_frames < went_on.with_hand
    assert went_on.passed
    with pytest.raises(AppError) as refused:
        kept_progress(path, IdleSettings(seed=4))
    assert refused.value.code is EvaluateFault.PROGRESS_OF_OTHERS
