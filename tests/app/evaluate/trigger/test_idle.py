"""Hands that do not press, by depth with holes: progress is kept, and no clip is drawn twice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from app.evaluate.harness import EvaluateFault
from app.evaluate.noise import NoiseClip, NoiseFrame
from app.evaluate.trigger.idle import IdleResult, IdleSettings, evaluate_idle, kept_progress
from app.evaluate.trigger.idle_moves import CLIP_FRAMES
from app.system.errors import AppError

SETTINGS = IdleSettings(seed=3, threshold_m=0.33, holes=0.4)
EXACT = NoiseFrame(image=np.zeros((21, 2)), world=np.zeros((21, 3)), side_right=True, presence=0.9)
CLIPS = [NoiseClip(gesture="5", frames=(EXACT, EXACT))]


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


@pytest.mark.parametrize("other", [IdleSettings(seed=4), structs.replace(SETTINGS, program="b")])
def test_progress_of_other_settings_or_of_another_program_is_refused(tmp_path: Path, other: IdleSettings) -> None:
    path = tmp_path / "progress.json"
    for kept in (SETTINGS, structs.replace(SETTINGS, program="a")):
        run(IdleResult(settings=kept), 1, path)
        assert kept_progress(path, kept).frames == CLIP_FRAMES
        with pytest.raises(AppError) as refused:
            kept_progress(path, other)
        assert refused.value.code is EvaluateFault.PROGRESS_OF_OTHERS


def test_a_frame_that_lost_the_hand_has_none() -> None:
    before = IdleResult(settings=IdleSettings())
    clips = (NoiseClip(gesture="5", frames=frames) for frames in ((EXACT, EXACT), (EXACT, None)))
    seen = [evaluate_idle([clip], before, frames=1, step=lambda _: None) for clip in clips]
    assert 0 < seen[1].with_hand < seen[0].with_hand


def test_frames_are_left_out_several_at_a_time_of_the_same_moves() -> None:
    whole, half = IdleSettings(seed=3), IdleSettings(seed=3, left_out=0.5, together=3)
    every, some = (run(IdleResult(settings=settings), 2) for settings in (whole, half))
    assert every.left_out == 0
    assert 0.2 * some.frames < some.left_out < 0.8 * some.frames
    assert some.left_out % 3 == 0
    assert every.with_hand - some.left_out <= some.with_hand < every.with_hand
