"""Real processes, really killed: what the joints are told afterwards, and who is left behind.

No limit here is a measurement; `tools/bench_stop.py` measures.
"""

from __future__ import annotations

import multiprocessing
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import msgspec
import pytest
import zmq

from app.cli.tree import command
from app.demo.drives import emulated_drives
from app.ipc.links import address
from app.ipc.messages import OperatorCommand, OperatorKind
from app.ipc.states import Action, Effect, Event, GaitState
from app.ipc.streams import AUDIT, OPERATOR
from app.session.shared import held_session
from app.system.config import JointsConfig
from app.system.errors import AppError
from app.system.legs_lock import claim_legs
from app.system.paths import Home
from hal.errors import HardwareError, StopInputFault
from hal.inputs.device import InputDevice, InputRole
from hal.joints.device import JOINT_NAMES, load_exoskeleton
from hal.joints.protocol import Joint
from logs.read import records, session_paths
from logs.reason import Reason
from logs.records import ActionEnd, Command, EventRaised, Note, ProcessEnd, SessionEnd, StopInput
from testing.session import RealSession, Sniffer

pytestmark = pytest.mark.serial

EVERYBODY = ("control", "planner", "guardian", "audit")
DEVICE = load_exoskeleton()
EXIT = bytes.fromhex("FFFFFFFFFFFFFFFD")


@pytest.fixture
def session(tmp_path: Path) -> Iterator[RealSession]:
    """With simulated joints."""
    with RealSession(tmp_path) as one:
        yield one


@pytest.fixture
def on_the_bus(tmp_path: Path) -> Iterator[tuple[RealSession, Sniffer]]:
    """With emulated drives on a bus, and a witness on it."""
    with emulated_drives(JointsConfig(kind="can"), wearer=None) as joints:
        sniffer = Sniffer(joints.interface, joints.channel)
        try:
            with RealSession(tmp_path, joints) as one:
                yield one, sniffer
        finally:
            sniffer.close()


def power(session: RealSession) -> None:
    """Power the drives; whether a busy host lets them reach standing does not matter here."""
    session.send(OperatorKind.CONFIRM_PATIENT)
    session.until(lambda s: s.patient_confirmed and bool(s.allowed), "readiness")
    session.send(OperatorKind.ACT, Action.INITIALISE)
    session.until(lambda _: session.heartbeat is not None and session.heartbeat.enabled, "power")


def gains(data: bytes) -> tuple[int, int]:
    """Raw stiffness and damping of an MIT frame."""
    return (data[3] & 0x0F) << 8 | data[4], data[5] << 4 | data[6] >> 4


def commands_after(sniffer: Sniffer, time_ns: int) -> list[tuple[int, int, bytes]]:
    """Frames to the drives, in motor mode, after a moment."""
    drives = {joint.can_id for joint in DEVICE.joints}
    return [
        frame
        for frame in sniffer.frames
        if frame[0] > time_ns and frame[1] in drives and not frame[2].startswith(EXIT[:7])
    ]


def forged(kind: OperatorKind, action: Action | None = None) -> bytes:
    """A command of another process: newer than any of the console's."""
    command = OperatorCommand(sequence=10**9, kind=kind, sent_ns=time.monotonic_ns(), action=action)
    return msgspec.msgpack.encode(command)


def with_an_earlier_key(foreign: zmq.Socket[bytes]) -> None:
    foreign.curve_serverkey, _ = zmq.curve_keypair()
    foreign.curve_publickey, foreign.curve_secretkey = zmq.curve_keypair()


def gave_way_after_hold(session: RealSession, since_ns: int) -> bool:
    """Whether the legs were held before they were damped; what happened before this moment does not count."""
    names = [name for at_ns, name in session.effects if at_ns >= since_ns]
    return names.index("HOLD") < names.index("DAMP")


def ended_in_good_order(session: RealSession) -> None:
    """Control said last that no drive carries power; a busy host hands its last messages on late."""
    session.until(lambda _: session.heartbeat is not None and session.heartbeat.last, "control's last heartbeat")
    assert session.heartbeat is not None
    assert not session.heartbeat.enabled


def legs_free(session: RealSession) -> bool:
    """Whether another session may have the legs: a killed process is a zombie before its last thread lets go."""
    try:
        claim_legs(session.setup).close()
    except AppError:
        return False
    return True


def test_a_session_stands_walks_stops_and_ends_without_leaving_anybody(session: RealSession) -> None:
    walking = session.walk(steps=1)
    session.send(OperatorKind.STOP)
    held = session.until(lambda s: s.stop_command_ns > 0 and s.action is None, "hold")
    assert held.effect >= Effect.HOLD
    assert held.state is GaitState.BETWEEN or session.damped_since(walking.at_ns)
    assert held.stop_command_ns >= held.stop_received_ns > 0
    assert session.stand().state is GaitState.STANDING
    session.finish()
    session.until_ended(*EVERYBODY)


def test_a_process_without_the_key_moves_nothing_and_is_recorded(session: RealSession) -> None:
    """One that knows no key, and one of an earlier session; to control and to the audit process."""
    before = session.stand()
    assert stat.S_IMODE(session.setup.links.path.stat().st_mode) == 0o700  # nobody else's process comes near
    foreign: list[zmq.Socket[bytes]] = [zmq.Context.instance().socket(zmq.PUSH) for _ in range(4)]
    try:
        with_an_earlier_key(foreign[1])
        with_an_earlier_key(foreign[3])
        for one, stream in zip(foreign, (OPERATOR, OPERATOR, AUDIT, AUDIT), strict=True):
            one.setsockopt(zmq.LINGER, 0)
            one.connect(address(session.setup.links, stream.name).where)
            for command in 100 * [forged(OperatorKind.ACT, Action.WALK), forged(OperatorKind.SHUT_DOWN)]:
                with suppress(zmq.Again):  # ZeroMQ gives a server up that has refused the key: nobody would take it
                    one.send(command, zmq.NOBLOCK)
        now = session.until(lambda s: any(one.event is Event.FOREIGN_PEER for one in s.events), "the event")
    finally:
        for one in foreign:
            one.close()
    assert now.state is before.state or session.damped_since(before.at_ns)
    assert (now.action, now.steps) == (None, 0)
    assert now.refusal_count == before.refusal_count
    session.finish()
    (trail,) = session_paths(Home(session.setup.home).logs)
    kinds = [record.body for record in records(trail)]
    told = [body for body in kinds if isinstance(body, EventRaised) and body.event == Event.FOREIGN_PEER.value]
    assert 1 <= len(told) <= 5  # of 800 messages
    assert not [body for body in kinds if isinstance(body, Command) and body.action == Action.WALK.value]
    begun = {body.action for body in kinds if isinstance(body, ActionEnd)}
    assert begun == {Action.INITIALISE.value}, "the session's own"


def test_without_a_console_the_legs_are_held_and_everybody_ends_when_nobody_comes(tmp_path: Path) -> None:
    with RealSession(tmp_path, unattended_s=2.0) as session:
        session.walk(steps=1)
        killed_ns = session.kill("console")
        session.until(lambda s: s.effect >= Effect.HOLD, "hold")
        with pytest.raises(AppError, match="LEGS_HELD"):
            claim_legs(session.setup)
        session.until_ended("session", *EVERYBODY)
        ended_in_good_order(session)
        session.until(lambda _: legs_free(session), "the lock")
    assert held_session(Home(tmp_path)) is None
    assert not session.setup.links.path.exists()
    (trail,) = session_paths(Home(tmp_path).logs)
    found = [one.body for one in records(trail)]
    assert [one.ended for one in found if isinstance(one, ProcessEnd) and one.ended] == ["console"]
    assert any(isinstance(one, SessionEnd) for one in found), "the trail has its end"
    assert gave_way_after_hold(session, killed_ns)


def test_without_the_sessions_own_process_the_legs_are_held_then_everybody_ends(session: RealSession) -> None:
    session.walk(steps=1)
    killed_ns = session.kill("session")
    session.until_ended(*EVERYBODY)
    assert gave_way_after_hold(session, killed_ns)
    ended_in_good_order(session)


TAKE = """
import sys
from pathlib import Path
from app.session.host import SessionHost
from app.session.shared import held_session
from app.system.errors import AppError
from app.system.paths import Home, hold_home
home = Home(Path(sys.argv[1]))
try:
    with hold_home(home):
        host = SessionHost(held_session(home))
        host.start()
        print("taken", flush=True)
        sys.stdin.read()
        host.leave()
except AppError as error:
    print(error.code.name, flush=True)
"""


def test_a_session_is_taken_over_in_standing_and_in_mid_step_by_one_console_at_a_time(session: RealSession) -> None:
    before = session.stand()
    session.kill("console")
    session.until(lambda s: Event.CONSOLE_TIMEOUT in {event.event for event in s.events}, "the console's silence")
    session.take_over()
    taken = session.until(lambda s: s.lease == 2, "the takeover")
    damped = session.damped_since(before.at_ns)
    assert taken.effect is (Effect.DAMP if damped else Effect.HOLD)
    assert taken.state is GaitState.STANDING or damped
    session.walk(steps=1)
    session.leave()
    held = session.until(lambda s: s.effect >= Effect.HOLD and s.action is None, "hold")
    assert held.state is GaitState.BETWEEN
    arguments = [sys.executable, "-c", TAKE, str(session.setup.home)]
    both = [subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    said = sorted(one.stdout.readline().strip() for one in both if one.stdout is not None)
    assert said == ["HELD", "taken"]
    for one in both:
        one.communicate()
    session.take_over()
    session.until(lambda s: s.lease == 4, "the third takeover")
    assert session.stand().state is GaitState.STANDING
    session.finish()
    session.until_ended("session", *EVERYBODY)


def test_a_frozen_control_keeps_the_legs_after_its_console_and_its_guardian_are_killed(session: RealSession) -> None:
    session.stand()
    session.kill("control", signal.SIGSTOP)
    for name in ("console", "session", "guardian"):
        session.kill(name)
    session.until_ended("console", "session", "guardian")
    with pytest.raises(AppError, match=rf"LEGS_HELD pid=.*\b{session.pids['control']}\b"):
        claim_legs(session.setup)
    session.kill("control")
    session.until_ended("control")
    session.until(lambda _: legs_free(session), "the lock")


def test_a_closed_terminal_ends_control_in_good_order(session: RealSession) -> None:
    session.stand()
    session.kill("control", signal.SIGHUP)
    session.until_ended("control")
    ended_in_good_order(session)
    assert "DAMP" in [name for _, name in session.effects]


def test_without_a_guardian_nothing_new_begins_and_the_trail_names_what_was_killed(session: RealSession) -> None:
    session.stand()
    session.kill("planner")
    session.kill("guardian")
    session.until(lambda s: Event.GUARDIAN_TIMEOUT in {event.event for event in s.events}, "its event")
    session.send(OperatorKind.ACT, Action.WALK)
    refused = session.until(lambda s: s.refusal_count > 0, "refusal")
    assert refused.action is None
    session.finish()
    session.until_ended("session", *EVERYBODY)
    (path,) = session_paths(Home(session.setup.home).logs)
    found = [one.body for one in records(path) if isinstance(one.body, ProcessEnd) and one.body.ended]
    assert sorted((one.ended, one.pid) for one in found) == [
        (name, session.pids[name]) for name in ("guardian", "planner")
    ]
    assert [one.reason for one in found] == [Reason("ProcessFault.EXITED", {"exit_code": -9})] * 2


def test_when_control_is_killed_the_guardian_damps_the_drives_and_switches_them_off(
    on_the_bus: tuple[RealSession, Sniffer],
) -> None:
    session, sniffer = on_the_bus
    power(session)
    killed_ns = session.kill("control")
    session.until(lambda _: session.guardian is not None and session.guardian.acted, "the guardian's act")
    session.until(lambda _: any(data == EXIT for at, _, data in sniffer.frames if at > killed_ns), "switching off")
    damped = [frame for frame in commands_after(sniffer, killed_ns) if gains(frame[2])[0] == 0]
    assert {identifier for _, identifier, _ in damped} == {joint.can_id for joint in DEVICE.joints}
    assert all(gains(data)[1] > 0 for _, _, data in damped)
    first_exit_ns = min(at for at, _, data in sniffer.frames if data == EXIT and at > killed_ns)
    assert damped[0][0] < first_exit_ns, "damped first, then off"


def test_after_its_end_the_console_knows_whether_the_drives_are_off(on_the_bus: tuple[RealSession, Sniffer]) -> None:
    session, _ = on_the_bus
    power(session)
    session.until(lambda s: s.enabled, "power in the snapshot")
    session.send(OperatorKind.SHUT_DOWN)
    session.until_ended("control")
    assert session.snapshot is not None
    assert not session.snapshot.enabled


def test_after_its_end_the_console_knows_that_drives_did_not_confirm(on_the_bus: tuple[RealSession, Sniffer]) -> None:
    session, _ = on_the_bus
    power(session)
    session.until(lambda s: s.enabled, "power in the snapshot")
    (drives,) = [one for one in multiprocessing.active_children() if one.name == "emulated drives"]
    drives.kill()
    drives.join()
    session.send(OperatorKind.SHUT_DOWN)
    session.until_ended("control")
    assert session.snapshot is not None
    assert session.snapshot.enabled


def test_drives_that_do_not_answer_the_guardian_are_named(on_the_bus: tuple[RealSession, Sniffer]) -> None:
    session, _ = on_the_bus
    power(session)
    session.kill("guardian", signal.SIGSTOP)  # until the drives are gone: it may not hear them once
    session.kill("control")
    (drives,) = [one for one in multiprocessing.active_children() if one.name == "emulated drives"]
    drives.kill()
    drives.join()
    session.kill("guardian", signal.SIGCONT)
    session.until(lambda _: session.guardian is not None and session.guardian.unanswered == JOINT_NAMES, "four joints")
    session.finish()
    session.until_ended("session", *EVERYBODY)
    (path,) = session_paths(Home(session.setup.home).logs)
    notes = [record.body for record in records(path) if isinstance(record.body, Note)]
    told = [note.text for note in notes if isinstance(note.text, Reason) and note.text.code.endswith(".NOT_ANSWERED")]
    joints = tuple(Reason(f"Joint.{joint.name}") for joint in Joint)
    assert [(one.values["joints"], one.values["action"]) for one in told] == [
        (joints, Reason(f"GuardianAction.{action}")) for action in ("DAMP", "SWITCH_OFF")
    ]


def test_a_control_that_was_frozen_comes_back_damped_and_may_continue_when_it_is_acknowledged(
    on_the_bus: tuple[RealSession, Sniffer],
) -> None:
    session, sniffer = on_the_bus
    power(session)
    stopped_ns = session.kill("control", signal.SIGSTOP)
    session.until(lambda _: session.guardian is not None and session.guardian.acted, "the guardian's act")
    assert any(gains(data)[0] == 0 for _, _, data in commands_after(sniffer, stopped_ns))
    resumed_ns = session.kill("control", signal.SIGCONT)
    back = session.until(lambda s: s.effect is Effect.DAMP, "damping")
    assert Event.GUARDIAN_ACTED in {event.event for event in back.events}
    assert back.state in {GaitState.BETWEEN, GaitState.UNPOWERED}
    session.send(OperatorKind.TORQUE_OFF)
    session.until(lambda s: not s.enabled, "torque off")
    after = commands_after(sniffer, resumed_ns)
    first_ns = min(at for at, _, data in after if not gains(data)[0])
    stiff = [(at, drive) for at, drive, data in after if gains(data)[0]]
    assert all(at < first_ns for at, _ in stiff), "gripped while sunk"
    assert len({drive for _, drive in stiff}) == len(stiff), "more than what was being sent when it was frozen"
    session.until(lambda _: session.guardian is not None and not session.guardian.acted, "the guardian's watch")
    session.settle()
    session.stand()


def test_a_simulated_stop_button_is_pressed_from_another_terminal(tmp_path: Path) -> None:
    pendant = InputDevice(name="pendant", role=InputRole.WEARER, kind="simulated")
    with RealSession(tmp_path, inputs=(pendant,)) as session:

        def press(how: str) -> None:
            command().main(["press-input", "pendant", how, "--home", str(tmp_path)], standalone_mode=False)

        session.send(OperatorKind.CONFIRM_PATIENT)
        untried = session.until(lambda now: now.why_not is not None and "UNPRESSED" in now.why_not.code)
        assert untried.effect is Effect.REFUSE, "it was closed from the first tick on"
        press("tap")
        session.until(lambda now: now.stop_inputs[0].pressed_once, "the first press")
        session.stand()
        press("unplug")
        session.until(lambda now: now.effect is Effect.HOLD, "the hold")
        press("release")
        held = session.until(lambda now: not now.stop_inputs[0].open)
        assert held.effect is Effect.HOLD
        session.settle()
        with pytest.raises(HardwareError) as refused:
            command().main(["press-input", "pedal", "--home", str(tmp_path)], standalone_mode=False)
        assert refused.value.code is StopInputFault.NOT_SIMULATED
        session.finish()
    found = [one.body for one in records(session_paths(Home(tmp_path).logs)[-1]) if isinstance(one.body, StopInput)]
    assert [one.contact for one in found] == ["closed", "open", "closed", "silent", "closed"]
    assert {one.name for one in found} == {"pendant"}
