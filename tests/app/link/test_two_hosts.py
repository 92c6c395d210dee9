"""Two computers as real processes on loopback: pairing, a session, STOP acknowledged, cuts, replay, foreign peers."""

from __future__ import annotations

import os
import signal
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import pytest
import zmq
from msgspec.structs import replace

from app.demo.two_hosts import free_port, joints_process
from app.ipc.messages import OperatorKind
from app.ipc.snapshot import ActiveEvent, ControlSnapshot
from app.ipc.states import Action, ConsoleChange, Effect, Event, GaitState, StopSource
from app.link.beats import LOST_NS
from app.link.keys import own_key, peers_of
from app.session.host import SessionHost
from app.session.shared import held_session
from app.system.paths import Home
from logs.findings import Status
from logs.join import join_findings
from logs.keys import by_fingerprint, known_keys
from logs.read import records
from logs.reason import key_of
from logs.records import EventRaised, Note, Stop
from logs.verify import Evidence, exit_status, verify
from testing.two_hosts import TwoHosts, two_hosts
from tests.support.relay import Relay

pytestmark = [pytest.mark.serial, pytest.mark.xdist_group("two-hosts")]  # one session, test after test

STALLS = {  # of a host that keeps a process waiting: control, the guardian, the reader of STOP, this console
    Event.CONTROL_LATE,
    Event.CONTROL_STALLED,
    Event.GUARDIAN_ACTED,
    Event.GUARDIAN_TIMEOUT,
    Event.STOP_INPUTS_LATE,
    Event.CONSOLE_TIMEOUT,
    Event.PAUSE_TOO_LONG,
}


@dataclass
class Bed:
    """A session over a relay, and the two homes."""

    session: TwoHosts
    relay: Relay
    laptop: Path
    joints: Path
    port: int
    started_again: ExitStack  # `rleex joints`, after it died

    def start_joints_again(self) -> None:
        """`rleex joints`, as its service does."""
        self.session.joints_pid = self.started_again.enter_context(joints_process(Home(self.joints), self.port)).pid

    def trail(self) -> list[object]:
        """What the trail of the joints' computer holds."""
        return [one.body for one in records(self.joints / "logs" / f"{self.session.setup.session}.jsonl")]


@pytest.fixture(scope="module")
def bed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bed]:
    """One session for all tests of this file: starting it takes most of their time."""
    laptop, joints = tmp_path_factory.mktemp("laptop"), tmp_path_factory.mktemp("joints")
    (joints / "config.toml").write_text("unattended_s = 60\n", encoding="utf-8")
    port = free_port()
    with Relay(port) as relay, two_hosts(laptop, joints, port, host=f"127.0.0.1:{relay.port}") as session:
        with ExitStack() as again:
            yield Bed(session, relay, laptop, joints, port, again)
        relay.cut = False


def test_pairing_has_told_each_side_the_others_key(bed: Bed) -> None:
    (there,), (here,) = peers_of(Home(bed.joints)), peers_of(Home(bed.laptop))
    assert there.public == own_key(Home(bed.laptop)).public
    assert here.public == own_key(Home(bed.joints)).public
    for home in (bed.laptop, bed.joints):
        assert all(path.stat().st_mode & 0o077 == 0 for path in (home / "keys" / "link").iterdir())
    assert not (bed.joints / "keys" / "link" / "offer.json").exists(), "the code is good for one pairing"


def test_legs_stand_and_the_link_tells_its_figures(bed: Bed) -> None:
    now = bed.session.stand()
    assert now.state is GaitState.STANDING
    link = bed.session.until_link("processes")
    assert link.connected
    bed.session.until(lambda _: bed.session.latest is not None and bed.session.latest.guardian is not None, "guardian")
    assert {"audit", "guardian", "planner", "control"} <= {one.name for one in link.processes}
    assert link.uncertainty_ns is not None
    assert abs(link.offset_ns) <= link.uncertainty_ns, "both processes have the same clock"


def test_stop_is_acknowledged_by_control(bed: Bed) -> None:
    bed.session.walk(steps=1)
    bed.session.stop_acknowledged_s()
    now = bed.session.until(lambda now: now.effect >= Effect.HOLD, "the hold")
    assert caused(now) is Effect.HOLD, "one press is one STOP, by whichever way it came first"
    stops = [one.event for one in now.events if one.effect is Effect.HOLD and one.event not in STALLS]
    assert stops == [Event.STOP]
    first, moments = by_event(now)[Event.STOP], set[int]()

    def is_told_again(now: ControlSnapshot) -> bool:
        assert by_event(now)[Event.STOP].identity == first.identity, "what the console acknowledges by"
        moments.add(by_event(now)[Event.STOP].since_ns)
        return len(moments) > 1

    bed.session.until(is_told_again, "another estimate of the clock")


def test_a_short_cut_at_rest_changes_nothing_by_itself(bed: Bed) -> None:
    before = bed.session.stand()
    bed.relay.cut = True
    bed.session.go_on(0.6)
    bed.relay.cut = False
    after_ns = before.at_ns + 600_000_000
    now = bed.session.until(
        lambda now: now.at_ns > after_ns and (bool(now.allowed) or was_stalled(bed, now, before.at_ns)), "the link"
    )
    assert (now.state is before.state and now.effect < Effect.HOLD) or was_stalled(bed, now, before.at_ns)


def test_a_lost_link_in_a_walk_holds_and_its_return_moves_nothing(bed: Bed) -> None:
    bed.session.walk(steps=1)
    bed.relay.cut = True
    bed.session.send(OperatorKind.ARM)  # all expire on the way
    bed.session.send(OperatorKind.ACT, Action.INITIALISE)
    bed.session.send(OperatorKind.ACKNOWLEDGE)
    bed.session.go_on(2.0 * LOST_NS / 1e9)
    bed.relay.cut = False
    now = bed.session.until(lambda now: any(one.event is Event.STOP for one in now.events), "as a takeover")
    assert caused(now) is Effect.HOLD
    assert not now.armed
    assert now.action is None
    steps = now.steps
    bed.session.go_on(0.5)
    assert bed.session.snapshot is not None
    assert bed.session.snapshot.steps == steps
    assert caused(bed.session.snapshot) is Effect.HOLD, "until it is acknowledged"


def test_stop_reaches_control_as_soon_as_the_link_is_back(bed: Bed) -> None:
    bed.session.stand()
    bed.relay.cut = True
    bed.session.go_on(0.3)
    bed.session.send(OperatorKind.STOP)
    bed.session.go_on(0.2)
    assert bed.session.latest is not None
    assert bed.session.latest.stop_sent_ns, "sent is not acknowledged"
    bed.relay.cut = False
    bed.session.until(lambda now: caused(now) is Effect.HOLD, "the hold")


def test_a_spoken_stop_comes_by_packet_alone_and_counts_once(bed: Bed) -> None:
    bed.session.stand()
    bed.relay.frames_wait = True
    bed.session.send(OperatorKind.VOICE_STOP)
    bed.session.until_acknowledged()
    bed.relay.frames_wait = False
    now = bed.session.until(lambda now: any(one.event is Event.VOICE_STOP for one in now.events), "the event")
    assert caused(now) is Effect.HOLD
    bed.session.until(lambda _: bool(spoken_stops(bed)), "the trail's record")
    bed.session.go_on(0.5)
    assert len(spoken_stops(bed)) == 1, "its frame came later"


def test_replayed_and_foreign_packets_move_nothing_and_are_counted(bed: Bed) -> None:
    bed.session.stand()
    stops = len(spoken_stops(bed)) + 1
    bed.session.send(OperatorKind.VOICE_STOP)
    bed.session.until(lambda now: caused(now) is Effect.HOLD and len(spoken_stops(bed)) == stops, "the hold")
    replayed = bed.relay.packets[-50:]  # with that STOP among them
    before = bed.session.stand()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as foreign:
        for datagram in (*replayed, *(bytes([kind]) * 200 for kind in range(100))):
            foreign.sendto(datagram, ("127.0.0.1", bed.port))
    with zmq.Context() as stranger, stranger.socket(zmq.DEALER) as dealer:
        public, secret = zmq.curve_keypair()
        dealer.setsockopt(zmq.LINGER, 0)
        dealer.setsockopt(zmq.CURVE_SERVERKEY, own_key(Home(bed.joints)).public.encode())
        dealer.setsockopt(zmq.CURVE_PUBLICKEY, public)
        dealer.setsockopt(zmq.CURVE_SECRETKEY, secret)
        dealer.connect(f"tcp://127.0.0.1:{bed.port}")
        dealer.send(b"\xc1 malformed")
        now = bed.session.until(lambda now: any(one.event is Event.FOREIGN_PEER for one in now.events), "the event")
        assert now.state is before.state or was_stalled(bed, now, before.at_ns)
        assert caused(now, before.at_ns) <= Effect.REFUSE, [one.event for one in now.events]
    bed.session.go_on(0.5)
    assert len(spoken_stops(bed)) == stops, "a STOP that is repeated is none"


def test_joints_that_died_are_started_again_and_the_session_goes_on_as_a_takeover(bed: Bed) -> None:
    bed.session.walk(steps=1)
    os.kill(bed.session.joints_pid, signal.SIGKILL)
    bed.start_joints_again()
    now = bed.session.until(lambda now: any(one.event is Event.STOP for one in now.events), "as a takeover")
    assert caused(now) is Effect.HOLD
    assert (now.armed, now.action) == (False, None)
    assert bed.session.stand().state is GaitState.STANDING


def test_a_laptops_audit_process_that_is_silent_refuses_new_actions(bed: Bed) -> None:
    bed.session.stand()
    (audit,) = [one.pid for one in bed.session.console.processes() if one.name == "audit"]
    os.kill(audit, signal.SIGSTOP)
    try:
        now = bed.session.until(lambda now: Event.AUDIT_WRITE_FAILED in present(now), "the event")
        assert not now.allowed
    finally:
        os.kill(audit, signal.SIGCONT)
    bed.session.until(lambda now: Event.AUDIT_WRITE_FAILED not in present(now), "its end")


def test_joints_started_again_after_a_takeover_at_the_laptop_hear_the_new_console(bed: Bed) -> None:
    held = held_session(Home(bed.laptop))
    assert held is not None
    bed.session.console.leave()
    bed.session.console = SessionHost(replace(held, operator="tom"))
    bed.session.console.start()
    bed.session.until(lambda now: any(one.event is Event.STOP for one in now.events), "the takeover")
    assert bed.session.stand().state is GaitState.STANDING
    os.kill(bed.session.joints_pid, signal.SIGKILL)
    bed.start_joints_again()
    bed.session.until(lambda now: any(one.event is Event.STOP for one in now.events), "as a takeover")
    assert bed.session.stand().state is GaitState.STANDING
    bed.session.until(lambda _: len(takeovers(bed)) > 1, "the trail's records")
    assert set(takeovers(bed)[-2:]) == {"tom"}


def by_event(now: ControlSnapshot) -> dict[Event, ActiveEvent]:
    return {one.event: one for one in now.events}


def present(now: ControlSnapshot) -> set[Event]:
    """The events whose condition holds."""
    return {one.event for one in now.events if one.present}


def takeovers(bed: Bed) -> list[object]:
    """Who took over, in the trail of the joints' computer."""
    texts = [one.text for one in bed.trail() if isinstance(one, Note) and not isinstance(one.text, str)]
    return [text.values["operator"] for text in texts if text.code == key_of(ConsoleChange.TAKEN_OVER)]


def was_stalled(bed: Bed, now: ControlSnapshot, since_ns: int) -> bool:
    """Whether the host, not the link, kept control waiting until the guardian damped the legs."""
    return bed.session.damped_since(since_ns) and any(one.event is Event.CONTROL_STALLED for one in now.events)


def test_after_the_end_the_laptop_knows_that_the_drives_are_off(bed: Bed) -> None:
    session = bed.session
    session.stand()
    session.until(lambda now: now.enabled, "power in the snapshot")
    session.send(OperatorKind.SHUT_DOWN)
    session.until(lambda now: not now.enabled, "control's last snapshot")


def test_both_trails_prove_themselves_and_tell_of_the_link(bed: Bed) -> None:
    bed.session.close()
    session = bed.session.setup.session
    findings = []
    for home in (bed.laptop, bed.joints):
        keys = Evidence(keys=by_fingerprint(known_keys(home / "keys")))
        findings += verify([home / "logs" / f"{session}.jsonl"], keys)
    assert exit_status(findings) == 0
    joins = join_findings(findings)
    assert len(joins) == 2, "each trail names the other's records"
    assert all(join.status is Status.SOUND and join.mentions > 3 for join in joins)
    bodies = bed.trail()
    codes = [one.text.code for one in bodies if isinstance(one, Note) and not isinstance(one.text, str)]
    assert "LinkNotice.LAPTOP_CAME" in codes
    assert "LinkNotice.LINK_RETURNED" in codes
    assert "LinkNotice.COMMAND_STALE" in codes
    assert any(isinstance(one, EventRaised) and one.event == Event.FOREIGN_PEER.value for one in bodies)


def spoken_stops(bed: Bed) -> list[Stop]:
    """The trail's."""
    return [one for one in bed.trail() if isinstance(one, Stop) and one.by == StopSource.VOICE.value]


def caused(now: ControlSnapshot, since_ns: int = 0) -> Effect:
    """The strongest effect of what was done since then; a host that stalled adds events of its own."""
    events = (one for one in now.events if one.since_ns > since_ns and one.event not in STALLS)
    return max((one.effect for one in events), default=Effect.NOTE)
