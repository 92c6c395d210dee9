"""Two hands in a scene, detected without errors: what the clips show, and that only the enrolled hand commands."""

from __future__ import annotations

import math
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from app.evaluate.detector_pool import PoolDetector
from app.evaluate.harness import FRAME_NS, EvaluateFault, kept_lines
from app.evaluate.loop.response import APPROACH_M
from app.evaluate.trigger import foreign_stage
from app.evaluate.trigger.foreign import ForeignResult, KindResult, PushResult, evaluate_foreign, foreign_table
from app.evaluate.trigger.foreign_clips import (
    BESIDE_M,
    CLIP_FRAMES,
    IN_NS,
    OUTSIDE_M,
    SECOND_NS,
    Clip,
    ForeignKind,
    PushKind,
    clips,
    turned,
)
from app.evaluate.trigger.foreign_stage import CROSSED_BEGIN_NS, ClipOutcome
from app.system.errors import AppError
from hal.cameras.digital_hand.driver import DigitalHandCamera
from hal.cameras.digital_hand.render import Rendered, Scene, keypoints_m, person_of, posed
from kgdfa.hand import Hand
from tests.support.known_hands import known_hand

IMAGE = np.zeros((720, 1280, 3), np.uint8)
IN_FRAMES = IN_NS // FRAME_NS


class KnownHands:
    """Detector and camera at once: finds the hands of the scene that was rendered last, where its image has them."""

    def __init__(self) -> None:
        self._hands: tuple[Hand, ...] = ()

    def render(self, scene: Scene, _seed: int) -> Rendered:
        found = [known_hand(one) for one in (scene, scene.second) if one is not None]
        self._hands = tuple(hand for hand in found if hand is not None and inside(hand))
        return Rendered(IMAGE, None)

    def detect(self, _image: Any, _captured_ns: int = 0) -> tuple[Hand, ...]:
        return self._hands

    def follow(self, hand: Hand | None, unknown: bool, sought: object) -> None:
        """It finds every hand in any case."""


def inside(hand: Hand) -> bool:
    x, y = hand.palm_centre_px
    return bool(0 <= x < 1280 and 0 <= y < 720)


class HerePool:
    """Runs each piece of work when it is asked for, before those hands."""

    def __init__(self, known: KnownHands, stop_after: int = 1000) -> None:
        inner: Any = known
        self.detector, self._left = PoolDetector(inner), stop_after

    def submit(self, _do: Any, work: Any, piece: Any) -> Future[Any]:
        self._left -= 1
        done: Future[Any] = Future()
        if self._left < 0:
            done.set_exception(KeyboardInterrupt())
        else:
            done.set_result(work(self.detector, piece))
        return done


@pytest.fixture
def known(monkeypatch: pytest.MonkeyPatch) -> KnownHands:
    hands = KnownHands()
    monkeypatch.setattr(foreign_stage, "render", hands.render)
    return hands


def run(known: KnownHands, wanted: list[Clip], keep: Path | None = None, stop_after: int = 1000) -> ForeignResult:
    pool: Any = HerePool(known, stop_after)
    return evaluate_foreign(pool, wanted, lambda: None, keep)


def clips_of(result: ForeignResult) -> int:
    return sum(kind.clips for kind in result.kinds.values())


def frames_of(result: ForeignResult) -> int:
    return sum(kind.frames for kind in result.kinds.values())


def test_only_the_enrolled_hand_commands(known: KnownHands) -> None:
    result = run(known, clips(frames=5 * CLIP_FRAMES, pushes=1, seed=1))
    assert (clips_of(result), result.commands, result.interrupted) == (5, 0, False)
    assert 5 * CLIP_FRAMES - 5 * IN_FRAMES < frames_of(result) < 5 * CLIP_FRAMES, "not while it is still outside"
    assert result.pushes == {name: PushResult(pushes=1, right=1) for name in ("alone", "beside", "crossed")}
    alone = (result.kinds[kind.value] for kind in (ForeignKind.OTHER_SIDE, ForeignKind.SAME_SIDE))
    assert [(one.without > 0, one.refused > 50) for one in alone] == [(True, True)] * 2


def test_a_run_that_was_ended_goes_on_where_it_was(
    known: KnownHands, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(foreign_stage, "CLIP_FRAMES", 10)
    wanted, keep = clips(frames=2 * CLIP_FRAMES, pushes=0, seed=1), tmp_path / "clips.jsonl"
    ended = run(known, wanted, keep, stop_after=1)
    assert (clips_of(ended), ended.interrupted) == (1, True)
    rest: Any = HerePool(known, stop_after=1)
    result = evaluate_foreign(rest, wanted, lambda: None, keep)
    assert (clips_of(result), result.interrupted) == (2, False)
    assert result == run(known, wanted)


def test_clips_of_another_program_are_refused(
    known: KnownHands, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(foreign_stage, "CLIP_FRAMES", 10)
    wanted, keep = clips(frames=CLIP_FRAMES, pushes=0, seed=1), tmp_path / "clips.jsonl"
    assert clips_of(run(known, wanted, keep)) == 1
    (kept,) = kept_lines(keep, ClipOutcome)
    for program in ("another", ""):
        keep.write_bytes(msgspec.json.encode(msgspec.structs.replace(kept, program=program)) + b"\n")
        with pytest.raises(AppError) as refused:
            run(known, wanted, keep)
        assert refused.value.code is EvaluateFault.PROGRESS_OF_OTHERS


def test_clips_are_the_same_for_the_same_seed_and_others_for_another() -> None:
    drawn = [clips(frames=1000, pushes=4, seed=seed) for seed in (1, 1, 2)]
    assert drawn[0] == drawn[1]
    assert all(one.other != two.other for one, two in zip(drawn[0], drawn[2], strict=True) if one.other is not None)
    assert len({clip.name for clip in (*drawn[0], *drawn[2])}) == len(drawn[0]) + len(drawn[2])


def test_another_seed_enrols_other_people() -> None:
    people = [{clip.own_seed for clip in clips(frames=1000, pushes=12, seed=seed)} for seed in (1, 2)]
    assert [len(one) for one in people] == [10 + 12] * 2
    assert not people[0] & people[1]


def test_pushes_are_the_same_beside_any_number_of_frames() -> None:
    some, none = (clips(frames=frames, pushes=4, seed=1)[-12:] for frames in (1000, 0))
    assert some == none


def test_a_hand_that_stays_outside_the_image_counts_no_frame(
    known: KnownHands, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.evaluate.trigger.foreign_clips.IN_NS", 10**15)  # away stays 1
    result = run(known, clips(frames=CLIP_FRAMES, pushes=0, seed=1))
    assert (clips_of(result), frames_of(result)) == (1, 0)


def test_the_table_shows_the_clips_of_each_kind() -> None:
    result = ForeignResult(kinds={ForeignKind.BESIDE.value: KindResult(clips=7, frames=650)})
    (row,) = zip(*(column.cells for column in foreign_table(result).columns), strict=True)
    assert [str(cell) for cell in row[1:]] == ["7", "650", "0", "0", "0", "0%"]


@pytest.mark.parametrize(
    ("roll_deg", "aside", "kind"),
    [(90, 1, PushKind.BEHIND), (90, -1, PushKind.BESIDE), (-90, 1, PushKind.BESIDE), (180, 1, PushKind.BESIDE)],
)
def test_a_hand_that_stands_beyond_the_enrolled_one_has_its_arm_behind_it(
    roll_deg: int, aside: int, kind: PushKind
) -> None:
    push = next(clip for clip in clips(frames=0, pushes=1, seed=1) if clip.other is not None)
    assert push.other is not None
    other = replace(push.other, roll_rad=math.radians(roll_deg), shift_m=(aside * BESIDE_M, 0.0))
    assert replace(push, other=other).push is kind


def test_an_arm_behind_the_enrolled_hand_is_clear_of_it() -> None:
    behind = [clip for clip in clips(frames=0, pushes=60, seed=1) if clip.push is PushKind.BEHIND]
    assert len(behind) > 5
    for clip in behind:
        assert clip.other is not None
        own = DigitalHandCamera(seed=clip.own_seed, person=person_of(clip.own_seed), clock_ns=lambda: 0)
        own.command(move_m=(0.0, 0.0, -APPROACH_M), at_ns=0)
        mine, other = own.scene(SECOND_NS).place, clip.other.scene(clip.other.camera(), SECOND_NS).place
        assert mine is not None
        assert other is not None
        assert other.position_m[2] - mine.position_m[2] > 0.06, "half an arm's and half a hand's thickness"


def test_a_hand_that_crosses_has_drawn_back_to_its_own_side_before_the_push() -> None:
    others = [clip.other for clip in clips(frames=0, pushes=40, seed=1) if clip.push is PushKind.CROSSED]
    assert len(others) == 40
    for other in others:
        assert other is not None
        camera = other.camera()
        placed = [other.scene(camera, at_ns).place for at_ns in (IN_NS, 2 * IN_NS, CROSSED_BEGIN_NS)]
        across_m, back_m, begun_m = (place.position_m[0] for place in placed if place is not None)
        assert across_m * begun_m < 0, "on the other side at first"
        assert back_m == pytest.approx(begun_m, abs=0.005), "at rest before the push"
        assert begun_m * math.sin(other.roll_rad) < 0, "its arm would lie over the enrolled hand"


@pytest.mark.parametrize("degrees", [0, 90, 180, -90])
def test_a_hand_reaches_in_along_its_arm(degrees: int) -> None:
    scene = posed("5", person=person_of(1), position_m=(0.0, 0.0, 0.4))
    here, away = (turned(scene, math.radians(degrees), (0.0, 0.0), share) for share in (0.0, 1.0))
    at, gone = keypoints_m(here), keypoints_m(away)
    assert at is not None
    assert gone is not None
    arm = (at[0] - at[9])[:2]
    shift = (gone - at).mean(axis=0)[:2]
    assert float(arm @ shift) / float(np.linalg.norm(arm) * np.linalg.norm(shift)) > 0.95
    assert np.linalg.norm(shift) == pytest.approx(OUTSIDE_M)
