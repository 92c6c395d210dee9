"""`rleex audit explain`: from a trail alone, each hop with the values that decided, equal to the live ones."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import pytest
from msgspec.structs import replace
from typer.testing import CliRunner

from app.cli import cli
from app.ipc.states import GESTURE_OF
from app.text.catalogue import render, use_language
from app.text.recorded import render_recorded
from kgdfa.button_state import PressCancel
from logs.disk import Disk
from logs.errors import AuditError, AuditFault
from logs.explain.hops import Explanation, Hop, Step, explain, explain_file
from logs.explain.text import NAMED, lines, to_values
from logs.keys import load_or_make_key
from logs.read import records
from logs.reason import reason
from logs.records import (
    ActionEnd,
    Body,
    Cancel,
    Command,
    EventRaised,
    GuardRefusal,
    Press,
    Record,
    Refusal,
    Release,
    Stop,
    Transition,
)
from tests.app.control.moments import A, K, moving, now, standing
from tests.app.perception.test_reporting import ONE, OVER, push
from tests.support.audit_trails import moment, write_session
from tests.support.catalogues import entries

SCHEMA1 = Path(__file__).parent / "data" / "schema1"


def trail(folder: Path, bodies: list[Body]) -> list[Record]:
    (folder / "logs").mkdir()
    path = write_session(folder / "logs", "s1", load_or_make_key(folder / "keys"), Disk(), tuple(bodies))
    return records(path)


def only(found: list[Record], kind: type[Body]) -> Record:
    (record,) = (record for record in found if isinstance(record.body, kind))
    return record


def hops(explanation: Explanation) -> list[Hop]:
    return [step.hop for step in explanation.steps]


def at(explanation: Explanation, hop: Hop) -> Step:
    return next(step for step in explanation.steps if step.hop is hop)


def walked() -> list[Body]:
    """A press at the camera, and control's records of its release."""
    _, seen = push(*((safe_m, ONE, OVER) for safe_m in (0.3, 0.22, 0.195, 0.19, 0.25)))
    (release,) = (body for body in seen if isinstance(body, Release))
    rig = standing()
    rig.audit.clear()
    rig.report = {"released_recognised_ns": release.recognised_ns}
    rig.release(GESTURE_OF[A.SIT_DOWN])
    rig.tick(30)
    rig.settle()
    released_ns = next(body.released_ns for body in rig.audit if isinstance(body, Command))
    timed = (replace(body, captured_ns=released_ns) if isinstance(body, Release) else body for body in seen)
    return [*timed, *rig.audit]


def test_a_command_is_explained_from_its_first_frame_to_its_end(tmp_path: Path) -> None:
    bodies = walked()
    found = trail(tmp_path, bodies)
    end = only(found, ActionEnd)
    explanation = explain(found, end.sequence)
    wanted = [Hop.CAPTURED, Hop.RECOGNISED, Hop.PRESSED, Hop.RELEASED, Hop.ACCEPTED]
    known = [hop for hop in hops(explanation) if hop is not Hop.PLANNED]  # its moment is made up by this writer
    assert known[:5] == wanted
    assert known[-3:] == [Hop.COMMANDED, Hop.MOVED, Hop.ENDED]
    assert Hop.PLANNED in hops(explanation)
    assert isinstance(end.body, ActionEnd)
    assert at(explanation, Hop.COMMANDED).at_ns == end.body.first_command_ns
    for kind in (Press, Release, Command):
        assert hops(explain(found, only(found, kind).sequence)) == hops(explanation)


def test_each_compared_value_is_the_live_one(tmp_path: Path) -> None:
    reports, seen = push(*((safe_m, ONE, OVER) for safe_m in (0.3, 0.22, 0.195, 0.19, 0.25)))
    found = trail(tmp_path, seen)
    explanation = explain(found, only(found, Release).sequence)
    for hop, report in ((Hop.PRESSED, reports[2]), (Hop.RELEASED, reports[4])):
        live = report.button.compared
        assert live is not None
        told = {check.name: check for check in at(explanation, hop).checks}
        limit_m = live.threshold_m if hop is Hop.PRESSED else live.release_m
        assert (told["safe_distance_m"].value, told["safe_distance_m"].limit) == (live.distance_m, limit_m)
        assert (told["nearer_m"].value, told["nearer_m"].limit) == (live.nearer_m, live.nearer_limit_m)
        assert (told["beside_px"].value, told["beside_px"].limit) == (live.beside_px, live.beside_limit_px)
        assert (told["elapsed_ns"].value, told["elapsed_ns"].limit) == (live.elapsed_ns, live.elapsed_limit_ns)
        assert (told["gap_frames"].value, told["gap_frames"].limit) == (live.gap_frames, live.gap_limit_frames)
        assert (told["focal_px"].value, told["focal_px"].source) == (610.0, "assumed")
    assert at(explanation, Hop.CAPTURED).at_ns == reports[0].vote_ns[0]
    told = {check.name: check for check in at(explanation, Hop.PRESSED).checks}
    assert told["safe_distance_m"].margin == pytest.approx(0.005)


def test_a_cancel_is_explained_with_its_press(tmp_path: Path) -> None:
    _, seen = push((0.3, ONE, OVER), (0.22, ONE, OVER), (0.195, ONE, OVER), (0.19, None, OVER))
    found = trail(tmp_path, seen)
    explanation = explain(found, only(found, Cancel).sequence)
    assert hops(explanation)[-2:] == [Hop.PRESSED, Hop.CANCELLED]


def test_stop_is_explained_from_the_key_to_the_joint_command(tmp_path: Path) -> None:
    rig = moving()
    rig.audit.clear()
    rig.send(K.STOP)
    rig.tick(2)
    found = trail(tmp_path, rig.audit)
    explanation = explain(found, only(found, Stop).sequence)
    assert hops(explanation) == [Hop.SENT, Hop.RECEIVED, Hop.RAISED, Hop.ENDED, Hop.COMMANDED]
    assert at(explanation, Hop.SENT).at_ns == now(rig).stop_ns
    assert at(explanation, Hop.RECEIVED).at_ns == now(rig).stop_received_ns
    assert at(explanation, Hop.COMMANDED).at_ns == now(rig).stop_command_ns > now(rig).stop_received_ns


def test_a_refusal_by_an_event_is_explained_with_its_numbers(tmp_path: Path) -> None:
    rig = standing()
    rig.audit.clear()
    rig.spoil["late_ns"] = 60_000_000
    rig.tick()
    rig.send(K.ACT, A.SIT_DOWN)
    rig.tick()
    found = trail(tmp_path, rig.audit)
    (check,) = at(explain(found, only(found, Refusal).sequence), Hop.REFUSED).checks
    assert (check.name, check.value, check.limit, check.margin) == ("late_ms", 60.0, 50.0, -10.0)


SEEN_NS = 1_000_000_000


@pytest.mark.parametrize(
    ("body", "shown"),
    [
        (EventRaised(event="out-of-range", effect="damp", text=None, quantity="angle_rad", value=-0.5, limit=-0.4), 1),
        (EventRaised(event="out-of-range", effect="damp", text=None, quantity="angle_rad", value=0.5, limit=0.4), 0),
        (GuardRefusal(reason=None, joint="left_knee", quantity="position", value=-0.2, limit=-0.1), 1),
        (GuardRefusal(reason=None, joint="left_knee", quantity="damping", value=-0.1, limit=0.0), 1),
        (GuardRefusal(reason=None, joint="left_knee", quantity="torque", value=50.1, limit=50.0), 0),
        (Refusal(reason=None, source="gesture", quantity="request_age_ms", value=-80.0, limit=-50.0), 1),
        (Cancel(reason=reason(PressCancel.TOO_LONG), held_ns=10_200_000_000, held_limit_ns=10_000_000_000), 0),
        (Cancel(reason=reason(PressCancel.TOO_SHORT), held_ns=33_000_000, held_limit_ns=50_000_000), 1),
    ],
)
def test_a_value_below_its_lower_limit_is_not_within_it(tmp_path: Path, body: Body, shown: int) -> None:
    found = trail(tmp_path, [body])
    explanation = explain(found, only(found, type(body)).sequence)
    (check,) = (check for step in explanation.steps for check in step.checks if check.value)
    assert check.margin is not None
    assert (check.least, check.margin < 0) == (bool(shown), True)
    (line,) = (line for line in lines(explanation, render_recorded) if "NOT kept" in line)
    assert ("at most", "at least")[shown] in line


@pytest.mark.parametrize(
    ("by", "event", "words"),
    [
        ("key", "stop", "the key was pressed"),
        ("key", "stop-again", "the key was pressed"),
        ("key", "STOP", "the key was pressed"),  # as schema 1 named it
        ("voice", "voice-stop", "STOP was said"),
        ("takeover", "stop", "another console took over"),
    ],
)
def test_a_stop_is_explained_by_how_it_was_given_and_by_its_own_event(
    tmp_path: Path, by: str, event: str, words: str
) -> None:
    stop = Stop(state="standing", effect="hold", sent_ns=SEEN_NS - 1, seen_ns=SEEN_NS, command_ns=SEEN_NS + 9, by=by)
    others = ("over-torque", "voice-stop" if by != "voice" else "stop")
    raised = [EventRaised(event=one, effect="hold", text=None, raised_ns=SEEN_NS) for one in (*others, event)]
    found = trail(tmp_path, [*raised, stop])
    own = next(one for one in found if isinstance(one.body, EventRaised) and one.body.event == event)
    for about in (only(found, Stop), own):
        explanation = explain(found, about.sequence)
        assert hops(explanation) == [Hop.SENT, Hop.RECEIVED, Hop.RAISED, Hop.COMMANDED]
        assert at(explanation, Hop.RAISED).record is own
        assert any(words in line for line in lines(explanation, render_recorded))


@pytest.mark.parametrize("language", ["en", "zh"])
def test_every_record_is_explained_in_both_languages(tmp_path: Path, language: str) -> None:
    use_language(language)
    bodies = walked()
    try:
        for record in (found := trail(tmp_path, bodies)):
            text = list(lines(explain(found, record.sequence), render_recorded))
            assert len(text) > 1
            assert any(line.startswith("►") for line in text)
            assert not any("{" in line or "compared." in line or "Hop" in line for line in text)
            json.dumps(to_values(explain(found, record.sequence)))
    finally:
        use_language("en")


def test_the_hops_of_every_record_are_in_the_order_of_their_moments(tmp_path: Path) -> None:
    command = Command(
        number=1, action="walk", source="gesture", state="standing", accepted_ns=moment(1).monotonic_ns, gesture="5"
    )
    transition = Transition(from_state="standing", to_state="right leg forward", action="walk", number=1)
    end = ActionEnd(
        number=1,
        action="walk",
        source="gesture",
        from_state="standing",
        to_state="standing",
        outcome="completed",
        ended_ns=moment(3).monotonic_ns,
    )
    found = trail(tmp_path, [command, transition, end])  # at 10, 20 and 30 ms
    assert hops(explain(found, only(found, Transition).sequence)) == [Hop.ACCEPTED, Hop.RECORDED, Hop.ENDED]
    for record in found:
        steps = explain(found, record.sequence).steps
        moments = [step.at_ns for step in steps if step.at_ns is not None]
        assert moments == sorted(moments), record.sequence


def test_what_an_older_trail_lacks_was_not_recorded_then() -> None:
    path = next(SCHEMA1.rglob("whole.jsonl"))
    found = records(path)
    for record in found:
        assert list(lines(explain(found, record.sequence), render_recorded))
    press = only(found, Press)
    text = "\n".join(lines(explain(found, press.sequence), render_recorded))
    assert "not recorded then" in text
    assert at(explain(found, press.sequence), Hop.CAPTURED).at_ns is None


def test_the_command_prints_text_or_json_and_refuses_a_number_that_is_none(tmp_path: Path) -> None:
    bodies = walked()
    found = trail(tmp_path, bodies)
    sequence = str(only(found, Command).sequence)
    around = ("audit", "explain", "s1")
    text = CliRunner().invoke(cli, [*around, sequence, "--home", str(tmp_path)])
    assert (
        text.exit_code,
        "safe distance, which decides: 19.5 cm, at most 20 cm: kept, 0.5 cm to spare" in text.output,
    ) == (0, True)
    told = json.loads(CliRunner().invoke(cli, [*around, sequence, "--json", "--home", str(tmp_path)]).output)
    # A plan's moment is that of its record's envelope, which this writer makes up.
    moments = [hop["at_ns"] for hop in told["hops"] if hop["hop"] != "planned"]
    assert all(before <= after for before, after in pairwise(moments))
    with pytest.raises(AuditError) as refused:
        explain_file(tmp_path / "logs" / "s1.jsonl", 10_000)
    assert refused.value.code is AuditFault.NO_RECORD
    assert "10000" in render(refused.value)


def test_each_named_quantity_is_worded() -> None:
    keys = {key.removeprefix("compared.") for key in entries("en") if key.startswith("compared.")}
    assert keys == NAMED
