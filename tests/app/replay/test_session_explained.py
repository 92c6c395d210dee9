"""A session from the hand to the joint commands in simulated time: each decision is explained by its live numbers.

The whole perception but the detector (drawn hands stand for it) and the whole step of control, with the messages that
the console receives as the live values: twelve actions, two cancelled pushes, three refusals, one STOP.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.demo.scenario import ALL_TWELVE
from app.ipc.snapshot import ActionReport
from app.ipc.states import Action
from kgdfa.gesture import Gesture
from logs import records as r
from logs.explain.hops import Hop, explain
from logs.read import records
from logs.records import Body, Record
from tests.app.perception.test_reporting import SCALE
from tests.support.live_session import NEAR_M, A, K, Live12, hand_at, written


def lived() -> Live12:
    """Twelve actions, two cancelled pushes, three refusals, one STOP."""
    live = Live12()
    live.rest()
    live.key(K.CONFIRM_PATIENT)
    live.push(Gesture.ZERO)  # refused: not armed
    live.rest()
    live.key(K.ARM)
    live.key(K.ACT, A.SIT_DOWN)  # refused: unpowered
    for step in ALL_TWELVE:
        live.push(step.gesture)
        if step.steps:
            live.rest(40)
        else:
            live.settle()
            assert live.state is step.end, step
    live.sign(Gesture.FIVE)
    live.approach(Gesture.FIVE)
    for _ in range(3):
        live.frame(hand_at(Gesture.FIVE, NEAR_M, aside_px=500.0))  # cancelled: left sideways
    live.rest()
    live.sign(Gesture.ONE)
    live.approach(Gesture.ONE)
    live.rest()  # cancelled: the hand is lost
    live.push(Gesture.ROCK)  # refused: the legs stand
    live.rest()
    live.push(Gesture.ONE)
    live.key(K.STOP)
    live.settle()
    live.entries += [("perception", live.rig.now_ns, body) for body in live.recorder.end()]
    return live


@pytest.fixture(scope="module")
def live() -> Live12:
    return lived()


@pytest.fixture(scope="module")
def home(live: Live12, tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("home")
    written(home, live.entries)
    return home


@pytest.fixture(scope="module")
def found(home: Path) -> list[Record]:
    return records(home / "logs" / "s.jsonl")


def of(found: list[Record], kind: type[Body]) -> Iterator[Record]:
    return (record for record in found if isinstance(record.body, kind))


def test_the_session_is_what_it_is_to_be(found: list[Record]) -> None:
    ends = [record.body for record in of(found, r.ActionEnd) if isinstance(record.body, r.ActionEnd)]
    assert len({end.action for end in ends if end.outcome == "completed"}) == 12
    assert len([*of(found, r.Cancel)]) == 2
    assert len([*of(found, r.Refusal)]) == 3
    assert len([*of(found, r.Stop)]) == 1


def test_each_press_release_cancel_and_hint_is_explained_with_the_numbers_of_its_message(
    live: Live12, found: list[Record]
) -> None:
    kept = {r.Press: True, r.Release: True}  # of these each limit is kept, of the others one at least is not
    decided = [*of(found, r.Press), *of(found, r.Release), *of(found, r.Cancel), *of(found, r.Hint)]
    assert len(decided) >= 34
    for record in decided:
        assert isinstance(record.body, r.Press | r.Release | r.Cancel | r.Hint)
        report, message = live.reports[record.body.captured_ns]
        compared = report.button.compared
        assert compared is not None
        (step,) = (step for step in explain(found, record.sequence).steps if step.record is record)
        told = {check.name: (check.value, check.limit) for check in step.checks}
        released = isinstance(record.body, r.Release | r.Cancel)
        limit_m = compared.release_m if released else message.threshold_m
        wanted: dict[str, tuple[float | None, float | None]] = {
            "safe_distance_m": (message.safe_distance_m, limit_m),
            "distance_m": (message.distance_m, None),
            "previous_m": (compared.previous_m, None),
            "nearer_m": (compared.nearer_m, compared.nearer_limit_m),
            "beside_px": (compared.beside_px, compared.beside_limit_px),
            "elapsed_ns": (compared.elapsed_ns, compared.elapsed_limit_ns),
            "gap_frames": (compared.gap_frames, compared.gap_limit_frames),
            "anchor_m": (SCALE.anchor_m, None),
            "focal_px": (SCALE.focal_px, None),
        }
        if not released:
            wanted["approached_m"] = (compared.approached_m, compared.approach_limit_m)
        if released:
            wanted["held_ns"] = (compared.held_ns, compared.held_limit_ns)
        assert told == wanted
        margins = [check.margin for check in step.checks if check.margin is not None]
        assert not kept.get(type(record.body)) or min(margins) >= 0, (record, step.checks)


def test_each_onset_is_explained_with_the_numbers_of_its_message(live: Live12, found: list[Record]) -> None:
    for record in of(found, r.GestureOnset):
        assert isinstance(record.body, r.GestureOnset)
        report, message = live.reports[record.body.captured_ns]
        assert record.body.vote_ns == report.vote_ns
        step = next(step for step in explain(found, record.sequence).steps if step.record is record)
        told = {check.name: check.value for check in step.checks}
        assert told == {"confidence": message.confidence, "votes": message.votes}


def test_each_action_is_explained_with_the_moments_that_control_published(live: Live12, found: list[Record]) -> None:
    published: dict[int, ActionReport] = {one.number: one for each in live.snapshots for one in each.reports}
    for record in of(found, r.ActionEnd):
        assert isinstance(record.body, r.ActionEnd)
        explanation = explain(found, record.sequence)
        at = {step.hop: step.at_ns for step in explanation.steps}
        wanted = published[record.body.number]
        assert at[Hop.RELEASED] == wanted.released_ns
        assert at[Hop.ACCEPTED] == wanted.accepted_ns
        assert at.get(Hop.COMMANDED) == (wanted.first_command_ns or None)
        assert at.get(Hop.MOVED) == (wanted.first_motion_ns or None)
        assert (Hop.CLOSING in at) is (record.body.action == Action.WALK_END.value)
        assert at[Hop.ENDED] == wanted.ended_ns
        _, recognised = live.reports[wanted.recognised_ns]
        assert at[Hop.RECOGNISED] == recognised.recognised_ns
        moments = [step.at_ns for step in explanation.steps if step.at_ns is not None]
        assert moments == sorted(moments)


def test_each_refusal_and_the_stop_is_explained_as_the_screen_showed_it(live: Live12, found: list[Record]) -> None:
    shown = [one.refusal for one in live.snapshots]
    for record in of(found, r.Refusal):
        assert isinstance(record.body, r.Refusal)
        assert record.body.reason in shown
        assert explain(found, record.sequence).steps[-1].at_ns == record.body.refused_ns
    (stop,) = of(found, r.Stop)
    at = {step.hop: step.at_ns for step in explain(found, stop.sequence).steps}
    state = live.rig.state
    assert state is not None
    assert (at[Hop.SENT], at[Hop.RECEIVED]) == (state.stop_ns, state.stop_received_ns)
    assert at[Hop.COMMANDED] == state.stop_command_ns > state.stop_received_ns


def run_replay(home: Path, *options: str) -> tuple[int, str]:
    ran = CliRunner().invoke(cli, ["audit", "replay", "s", "--home", str(home), *options])
    return ran.exit_code, ran.output


def test_the_replay_is_equal(home: Path, found: list[Record]) -> None:
    status, text = run_replay(home)
    assert (status, "0 differ" in text) == (0, True), text
    told = json.loads(run_replay(home, "--json")[1])
    assert (told["differences"], told["not_recorded"]) == ([], 0)
    assert told["replayed"] > 150
    assert told["writer"]["is"] == "not-recorded"
    assert "WARNING" in text
    assert "keypoints are not recorded" in text


@pytest.mark.parametrize(
    ("kind", "field", "value"),
    [
        (r.Press, "safe_distance_m", 0.21),
        (r.Release, "held_ns", 1),
        (r.Cancel, "beside_px", 0.5),
        (r.Refusal, "in_force", ("stop",)),
        (r.Command, "action", Action.WALK.value),
        (r.Command, "pressed_ns", 1),
        (r.EffectChanged, "to_effect", "damp"),
        (r.Stop, "effect", "damp"),
    ],
)
def test_one_value_changed_in_a_copy_that_is_signed_again_is_told(
    live: Live12, tmp_path: Path, kind: type[Body], field: str, value: object
) -> None:
    place = next(at for at, (_, _, body) in enumerate(live.entries) if isinstance(body, kind))
    process, at_ns, body = live.entries[place]
    forged = [*live.entries]
    forged[place] = (process, at_ns, msgspec.structs.replace(body, **{field: value}))
    home = tmp_path / "copy"
    found = written(home, forged)
    assert CliRunner().invoke(cli, ["audit", "verify", "--home", str(home)]).exit_code == 0
    status, text = run_replay(home)
    assert status == 1
    assert f"#{next(of(found, kind)).sequence} " in text
