"""The replay shows the moment that `rleex audit explain` names: gesture, distance, press and release, action."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from app.ipc.states import Action, Effect, Event, GaitState
from app.playback.moment import moment, snapshot_at
from app.playback.session import Playback, ReplayFault, moment_ns
from app.recording.schemas import JOINT_SETPOINT
from app.system.errors import AppError
from hal.joints.protocol import Joint
from kgdfa.gesture import Gesture
from logs import records as r
from logs.explain.hops import Hop, Step, explain
from logs.records import Record
from tests.support.live_session import K
from tests.support.recorded_session import Lived, RecordedLive


def of(playback: Playback, kind: type) -> list[Record]:
    return [one for one in playback.records if isinstance(one.body, kind)]


def hops(playback: Playback, record: Record) -> dict[Hop, Step]:
    """What explain says of a record, by hop."""
    return {step.hop: step for step in explain(playback.records, record.sequence).steps}


def compared(step: Step) -> dict[str, float | None]:
    return {check.name: check.value for check in step.checks}


def commands(playback: Playback) -> list[Record]:
    found = of(playback, r.Command)
    assert len(found) == 3
    return found


def test_at_each_push_it_has_the_gesture_the_distance_and_the_button_that_explain_names(playback: Playback) -> None:
    for command in commands(playback):
        assert isinstance(command.body, r.Command)
        steps = hops(playback, command)
        for hop, pressed in ((Hop.PRESSED, True), (Hop.RELEASED, False)):
            step = steps[hop]
            assert step.at_ns is not None
            report = moment(playback, step.at_ns).report
            assert report is not None
            assert report.captured_ns == step.at_ns
            assert report.gesture is Gesture(command.body.gesture)
            assert report.pressed is pressed
            assert report.safe_distance_m == compared(step)["safe_distance_m"]
            assert report.distance_m == compared(step)["distance_m"]
        assert report is not None
        assert report.released_gesture is report.gesture
        before = moment(playback, (steps[Hop.PRESSED].at_ns or 0) - 1).report
        assert before is not None
        assert not before.pressed


def test_at_each_recognition_it_has_the_gesture_and_its_confidence(playback: Playback) -> None:
    for command in commands(playback):
        step = hops(playback, command)[Hop.RECOGNISED]
        assert step.at_ns is not None
        assert step.record is not None
        assert isinstance(step.record.body, r.GestureOnset)
        report = moment(playback, step.at_ns).report
        assert report is not None
        assert report.gesture is Gesture(step.record.body.gesture)
        assert report.confidence == compared(step)["confidence"]
        assert report.votes == compared(step)["votes"]


def test_at_each_command_it_has_the_action_and_at_its_end_the_state(playback: Playback) -> None:
    for command in commands(playback):
        assert isinstance(command.body, r.Command)
        steps = hops(playback, command)
        accepted, ended = steps[Hop.ACCEPTED], steps[Hop.ENDED]
        before = moment(playback, (accepted.at_ns or 0) - 1).snapshot
        running = moment(playback, accepted.at_ns or 0).snapshot
        over = moment(playback, ended.at_ns or 0).snapshot
        assert before is not None
        assert running is not None
        assert over is not None
        assert before.action is None
        assert running.action is Action(command.body.action)
        assert running.state is GaitState(command.body.state)
        assert over.action is None
        assert ended.record is not None
        assert isinstance(ended.record.body, r.ActionEnd)
        assert over.state is GaitState(ended.record.body.to_state)


def test_at_the_refusal_it_has_the_reason_and_no_action(playback: Playback) -> None:
    (refusal,) = of(playback, r.Refusal)
    assert isinstance(refusal.body, r.Refusal)
    step = hops(playback, refusal)[Hop.REFUSED]
    snapshot = moment(playback, step.at_ns or 0).snapshot
    assert snapshot is not None
    assert snapshot.refusal == refusal.body.reason
    assert snapshot.action is None


def test_at_the_stop_the_legs_are_held(playback: Playback) -> None:
    (stop,) = of(playback, r.Stop)
    step = hops(playback, stop)[Hop.RECEIVED]
    assert step.at_ns == moment_ns(stop)
    before, after = (moment(playback, at_ns).snapshot for at_ns in (moment_ns(stop) - 1, moment_ns(stop)))
    assert before is not None
    assert after is not None
    assert (before.effect, after.effect) == (Effect.NOTE, Effect.HOLD)
    later = moment(playback, moment_ns(stop) + 60_000_000).snapshot
    assert later is not None
    assert "stop" in {one.event.value for one in later.events}


def test_a_stop_raised_anew_in_the_tick_of_its_acknowledgement_is_in_force(tmp_path: Path) -> None:
    live = RecordedLive(home=tmp_path)
    live.key(K.STOP)
    live.rest()
    for kind in (K.ACKNOWLEDGE, K.STOP):
        live.rig.send(kind)
    live.ticks(60)
    live.entries = [(process, at_ns + 200_000, body) for process, at_ns, body in live.entries]  # as they leave a tick
    with closing(Playback(live.close())) as playback:
        snapshot = snapshot_at(playback, playback.end_ns)
        assert snapshot is not None
        assert {one.event: one.present for one in snapshot.events}[Event.STOP]
        raised = of(playback, r.EventRaised)[-1]
        first = snapshot_at(playback, moment_ns(raised) - 1)
        assert first is not None
        assert {one.event: one.present for one in first.events}[Event.STOP]
        told = playback.landmarks.between(moment_ns(raised) - 1, playback.end_ns)
        kinds = [type(one.body) for one in told]
        assert kinds == [r.Acknowledgement, r.EventCleared, r.EventRaised, r.Stop]
        assert [one.sequence for one in told] == sorted(one.sequence for one in told)


def test_the_joints_are_controls_newest(session: Lived, playback: Playback) -> None:
    for at_ns, angles in session.live.measured[300::997]:
        snapshot = moment(playback, at_ns + 1).snapshot
        assert snapshot is not None
        assert [snapshot.joints[joint].angle_rad for joint in Joint] == angles


def test_the_targets_are_those_of_the_screen_where_a_joint_is_held_nowhere_too(
    session: Lived, playback: Playback
) -> None:
    first, *others = session.live.recorded
    recorded = playback.index.joints(JOINT_SETPOINT, 0, first.at_ns).values[:, 0]
    assert np.isnan(recorded).all(), "the drives are off"
    for live in (first, *others[::17]):
        snapshot = moment(playback, live.at_ns).snapshot
        assert snapshot is not None
        assert [one.target_rad for one in snapshot.joints] == [one.target_rad for one in live.joints]


def test_before_anything_was_recorded_there_is_nothing(playback: Playback) -> None:
    now = moment(playback, playback.begin_ns - 1)
    assert (now.snapshot, now.report, now.hand_m) == (None, None, None)


def test_the_hand_is_perceptions(session: Lived, playback: Playback) -> None:
    shown = [(at_ns, report) for at_ns, (report, _) in session.live.reports.items() if report.hand is not None]
    for at_ns, report in shown[::40]:
        assert report.hand is not None
        hand_m = moment(playback, at_ns).hand_m
        assert hand_m is not None
        assert hand_m.tolist() == report.hand.world_m.tolist()


def test_jumps_visit_every_told_moment_and_come_back(playback: Playback) -> None:
    at_ns, visited = playback.begin_ns - 1, []
    while (record := playback.landmarks.next_after(at_ns)) is not None:
        at_ns = moment_ns(record)
        visited.append(at_ns)
    assert visited == sorted({moment_ns(one) for one in playback.landmarks.between(0, playback.end_ns)})
    back, at_ns = [], playback.end_ns + 1
    while (record := playback.landmarks.newest(at_ns - 1)) is not None:
        at_ns = moment_ns(record)
        back.append(at_ns)
    assert back == visited[::-1]


def test_a_record_is_found_by_number_event_and_kind(playback: Playback) -> None:
    (stop,) = of(playback, r.Stop)
    assert playback.find(str(stop.sequence)) is stop
    assert playback.find("command") is commands(playback)[0]
    found = playback.find("not-armed").body
    assert isinstance(found, r.EventRaised)
    with pytest.raises(AppError) as caught:
        playback.find("flying")
    assert caught.value.code is ReplayFault.NO_SUCH_RECORD


def test_without_its_trail_the_copy_in_the_recording_tells_the_same(
    session: Lived, playback: Playback, tmp_path: Path
) -> None:
    alone = tmp_path / session.path.name
    alone.write_bytes(session.path.read_bytes())
    with closing(Playback(alone)) as copied:
        assert copied.records == playback.records
