"""The joints' end of a session without its processes: who commands it after a takeover, a lost link, a new process."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from app.control.requests import ACT_STALE_MS
from app.ipc import streams
from app.ipc.links import OrderedReceiver, Publisher, address
from app.ipc.messages import OperatorCommand, OperatorKind
from app.ipc.states import Effect
from app.ipc.streams import NS_PER_MS
from app.link.beats import LOST_NS
from app.link.clock import ClockEstimate
from app.link.served import ServedSession
from app.link.wire import LinkFault, SessionRequest, StopMark
from app.session.host import SessionHost
from app.session.setup import make_setup
from app.session.shared import share, start_of
from app.system.config import Config, JointsConfig
from app.system.paths import Home
from hal.errors import CanFault
from logs.journal import CHANGES
from logs.read import records
from logs.reason import Reason, key_of, reason
from logs.records import Change
from profiles.schema import DEMO_PATIENT
from testing.messages import STANDING
from tests.app.control.moments import now, standing

K = OperatorKind
SAME_CLOCK = ClockEstimate(0, 0, 0)
LATER_NS = 10_000_000_000
PATIENCE_S = 30.0


class NoWorkers(Executor):
    """Starts and ends no process."""

    def submit(self, _call: Callable[..., Any], /, *_args: Any, **_kwargs: Any) -> Future[Any]:
        return Future()


class AtOnce(Executor):
    """Starts and ends a session's processes before it goes on."""

    def submit(self, call: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        call(*args, **kwargs)
        return Future()


class Served:
    """A session that `rleex joints` serves, and the ends that control has of it."""

    def __init__(self, home: Path, *, held: bool) -> None:
        made = make_setup(Home(home), Config(), DEMO_PATIENT, None, permission=None)
        setup = replace(made, operator="ann", linked=True, host_pid=os.getpid() if held else 0)
        self.links = setup.links
        self._operator = OrderedReceiver(address(self.links, streams.OPERATOR.name), OperatorCommand)
        self._snapshots = Publisher(address(self.links, streams.SNAPSHOT.name))
        self._count = 0
        self.session = ServedSession(setup, NoWorkers(), held=held)
        self.commands = self.session.commands

    def say(self, *, lease: int = 1, stop_lease: int = 0, stop_sequence: int = 0) -> None:
        """Control's snapshot, until the session has it."""
        deadline = time.monotonic() + PATIENCE_S
        self._count += 1
        now = replace(
            STANDING,
            sequence=self._count,
            armed=False,
            lease=lease,
            stop_lease=stop_lease,
            stop_sequence=stop_sequence,
        )
        while self.session.snapshot != now:
            assert time.monotonic() < deadline, "the snapshot did not come"
            self._snapshots.send(now)
            self.session.snapshots.socket.poll(20)
            self.session.poll()

    def give(self, kind: OperatorKind, sequence: int, *, lease: int = 1, sent_ns: int, operator: str = "") -> None:
        """A command of the laptop's console that arrives at once."""
        command = OperatorCommand(sequence=sequence, lease=lease, kind=kind, sent_ns=sent_ns, operator=operator)
        self.commands.hand([command], SAME_CLOCK, sent_ns)

    def control_received(self, number: int) -> list[OperatorCommand]:
        """The next so many commands, and no more of them."""
        found = [self._operator.receive(PATIENCE_S) for _ in range(number)]
        assert self._operator.receive() is None
        return [one for one in found if one is not None]

    def close(self) -> None:
        self.session.close_links()
        self.session._host.leave()
        self._operator.close()
        self._snapshots.close()
        shutil.rmtree(self.links.path)


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Callable[[bool], Served]]:
    begun: list[Served] = []

    def begin(held: bool) -> Served:
        begun.append(Served(tmp_path, held=held))
        return begun[-1]

    yield begin
    for one in begun:
        one.close()


def test_resumed_it_hears_the_console_that_took_over_before(served: Callable[[bool], Served]) -> None:
    there = served(True)
    there.commands.commanded_by("tom")
    there.commands.adopt_lease(2)
    there.say(lease=5)
    there.commands.take_over_if_due(1_000)
    there.give(K.ARM, 7, lease=2, sent_ns=2_000)
    there.commands.hand_heartbeat(3_000, 2, SAME_CLOCK)
    taken, armed, heartbeat = there.control_received(3)
    assert (taken.kind, taken.lease, taken.operator) == (K.TAKE_OVER, 6, "tom")
    assert (armed.kind, armed.lease) == (K.ARM, 6)
    assert (heartbeat.kind, heartbeat.lease) == (K.HEARTBEAT, 6)


def test_resumed_it_lets_a_takeover_take_over_whose_lease_a_packet_told_before(
    served: Callable[[bool], Served],
) -> None:
    there = served(True)
    there.commands.adopt_lease(2)
    there.say(lease=1)
    there.commands.take_over_if_due(1_000)
    there.give(K.TAKE_OVER, 1, lease=2, sent_ns=2_000, operator="tom")
    assert [(one.kind, one.lease, one.operator) for one in there.control_received(2)] == [
        (K.TAKE_OVER, 2, "ann"),
        (K.TAKE_OVER, 3, "tom"),
    ]


def test_after_a_lost_link_it_takes_over_for_whoever_commands(served: Callable[[bool], Served]) -> None:
    there = served(False)
    there.give(K.TAKE_OVER, 1, lease=2, sent_ns=1_000, operator="tom")
    there.commands.hand_return(LATER_NS)
    there.commands.take_over_if_due(LATER_NS)
    assert [(one.lease, one.operator) for one in there.control_received(2)] == [(2, "tom"), (3, "tom")]


def test_what_was_given_while_the_link_was_lost_is_not_carried_out_but_for_stop(
    served: Callable[[bool], Served],
) -> None:
    there = served(False)
    there.commands.hand_return(LATER_NS)
    there.commands.take_over_if_due(LATER_NS)
    for number, kind in enumerate((K.ACKNOWLEDGE, K.ARM, K.STOP, K.DISARM), 1):
        there.give(kind, number, sent_ns=LATER_NS - 100_000_000)  # younger than a link's silence that counts as lost
    there.give(K.ARM, 5, sent_ns=LATER_NS + 1)
    assert [one.kind for one in there.control_received(4)] == [K.TAKE_OVER, K.STOP, K.DISARM, K.ARM]


def test_resumed_it_takes_no_earlier_stop_for_an_acknowledgement(served: Callable[[bool], Served]) -> None:
    there = served(True)
    there.commands.adopt_lease(1)
    there.say(lease=3, stop_lease=3, stop_sequence=57)  # of the process before
    there.commands.take_over_if_due(1_000)
    there.give(K.STOP, 9, sent_ns=2_000)
    taken, stop = there.control_received(2)
    there.say(lease=3, stop_lease=3, stop_sequence=57)
    assert not acknowledged(there)
    there.say(lease=4, stop_lease=4, stop_sequence=taken.sequence)
    assert not acknowledged(there)
    there.say(lease=4, stop_lease=stop.lease, stop_sequence=stop.sequence)
    assert acknowledged(there) == [(1, 9)]
    shown = there.session.shown()
    assert shown is not None
    assert (shown.lease, shown.stop_lease, shown.stop_sequence) == (1, 1, 9)


def test_a_stop_of_a_later_console_is_not_that_of_an_earlier_one_with_its_number(
    served: Callable[[bool], Served],
) -> None:
    """Neither has taken over yet: their lease is 0."""
    there = served(False)
    earlier, later = StopMark(0, 1, 1_000), StopMark(0, 1, 2_000)
    there.give(K.STOP, 1, lease=0, sent_ns=1_000)
    (first,) = there.control_received(1)
    there.say(stop_lease=first.lease, stop_sequence=first.sequence)
    there.give(K.STOP, 1, lease=0, sent_ns=2_000)
    there.commands.hand_stops([earlier, later], ClockEstimate(0, 300, 300), 3_000)  # again, by a better known clock
    (second,) = there.control_received(1)
    there.say(stop_lease=first.lease, stop_sequence=first.sequence)
    assert [*there.commands.stops] == [earlier]
    there.say(stop_lease=second.lease, stop_sequence=second.sequence)
    assert [*there.commands.stops] == [earlier, later]


def test_a_stop_that_an_earlier_process_handed_on_does_not_look_like_a_later_press(
    served: Callable[[bool], Served],
) -> None:
    """Control may have counted it, by the clock as that process knew it: 400 ns ahead, to 100."""
    there, before_ns = served(True), 1_000 - 500
    there.commands.adopt_lease(1)
    stop, later = StopMark(1, 9, 1_000), StopMark(1, 10, 5_000)
    there.commands.hand_stops([stop], ClockEstimate(0, 200, 400), 3_000)  # the takeover is still due
    there.say(lease=3)
    there.commands.take_over_if_due(4_000)
    there.commands.hand_stops([stop, later], ClockEstimate(0, 200, 400), 5_000)
    again, _, pressed = there.control_received(3)
    assert again.sent_ns <= before_ns
    assert pressed.sent_ns == 4_600


def test_a_stop_that_overtakes_an_acknowledgement_brings_it_along_and_so_holds(
    served: Callable[[bool], Served],
) -> None:
    """STOP comes by packet while the frame with the acknowledgement waits to be repeated."""
    there, rig = served(False), standing()
    first, acknowledged, second = (1_000_000_000 * place for place in (1, 2, 3))
    there.commands.hand_stops([StopMark(1, 1, first)], SAME_CLOCK, first)
    there.commands.hand_stops([StopMark(1, 1, first), StopMark(1, 3, second)], SAME_CLOCK, second, acknowledged, 1)
    there.give(K.ACKNOWLEDGE, 2, sent_ns=acknowledged)  # its frame
    given = there.control_received(3)
    assert [(one.kind, one.sent_ns) for one in given] == [
        (K.STOP, first),
        (K.ACKNOWLEDGE, acknowledged),
        (K.STOP, second),
    ]
    for one in given:
        rig.send(one.kind)
        rig.tick(100)
    assert now(rig).effect is Effect.HOLD


def test_a_stop_of_an_earlier_console_brings_along_what_the_present_one_acknowledged(
    served: Callable[[bool], Served],
) -> None:
    """The takeover counts as a first press; STOP is heard from everybody."""
    there, rig = served(False), standing()
    taken, acknowledged, pressed = (1_000_000_000 * place for place in (1, 2, 3))
    there.give(K.TAKE_OVER, 1, lease=2, sent_ns=taken, operator="tom")
    there.commands.hand_stops([StopMark(1, 9, pressed)], SAME_CLOCK, pressed, acknowledged, 2)
    there.give(K.ACKNOWLEDGE, 3, lease=2, sent_ns=acknowledged)  # its frame
    given = there.control_received(3)
    assert [(one.kind, one.lease, one.sent_ns) for one in given] == [
        (K.TAKE_OVER, 2, taken),
        (K.ACKNOWLEDGE, 2, acknowledged),
        (K.STOP, 0, pressed),
    ]
    for one in given:
        rig.send(K.STOP if one.kind is K.TAKE_OVER else one.kind)
        rig.tick(100)
    assert now(rig).effect is Effect.HOLD


def test_an_acknowledgement_from_before_a_stop_s_press_alone_precedes_it(served: Callable[[bool], Served]) -> None:
    there = served(False)
    there.commands.hand_stops([StopMark(1, 1, 5_000)], SAME_CLOCK, 5_000, 6_000, 1)
    there.commands.hand_stops([StopMark(1, 2, 7_000)], SAME_CLOCK, 7_000, 0)
    assert [one.kind for one in there.control_received(2)] == [K.STOP, K.STOP]


def test_keys_that_are_too_old_go_to_control_which_shows_that_it_refuses_them(
    served: Callable[[bool], Served],
) -> None:
    there = served(False)
    kinds = (K.ARM, K.ACT, K.ACKNOWLEDGE, K.CONFIRM_PATIENT, K.TORQUE_OFF)
    there.commands.hand(
        [OperatorCommand(sequence=number, kind=kind, sent_ns=1) for number, kind in enumerate(kinds, 1)],
        SAME_CLOCK,
        LOST_NS + 2,
    )
    assert [one.kind for one in there.control_received(2)] == [K.ARM, K.ACT]
    assert ACT_STALE_MS * NS_PER_MS < LOST_NS, "control refuses them"


def acknowledged(there: Served) -> list[tuple[int, int]]:
    """The STOPs that the laptop is told of."""
    return [(one.lease, one.sequence) for one in there.commands.stops]


def test_a_laptop_is_told_that_it_is_this_computer_s_file_that_keeps_a_session_from_starting(tmp_path: Path) -> None:
    """A sentence of the other computer's adapter would send its reader to the laptop's own."""
    config = Config(joints=JointsConfig(kind="can", interface="slcan", channel="/dev/ttyACM0"))
    made = make_setup(Home(tmp_path), config, DEMO_PATIENT, None, permission=None)
    session = ServedSession(replace(made, linked=True), AtOnce(), held=False)
    session.close_links()
    assert session.ended
    assert session.fault is not None
    assert session.fault.code == key_of(LinkFault.NOT_STARTED)
    detail = session.fault.values["detail"]
    assert isinstance(detail, Reason)
    assert (detail.code, detail.values["bus"]) == (key_of(CanFault.NOT_SHARED), "/dev/ttyACM0")


def test_what_an_editor_changed_here_is_on_record_under_the_laptops_operator(tmp_path: Path) -> None:
    home = Home(tmp_path)
    request = SessionRequest(
        session="20261121T093000Z-0a1b", profile=DEMO_PATIENT, operator="ann", role="therapist", signed_in=True
    )
    home.config.write_text('[joints]\nkind = "can"\n')
    for interface in ("local", "", ""):  # emulated, then twice real
        config = Config(joints=JointsConfig(kind="can", interface=interface))
        session = ServedSession.begun(home, config, request, NoWorkers())
        assert (home.logs / CHANGES).exists() is not config.joints.emulated
        session.close_links()
        session._host.leave()
    (record,) = (one for one in records(home.logs / CHANGES) if isinstance(one.body, Change))
    assert isinstance(record.body, Change)
    assert (record.operator, record.body.role, record.body.proof) == ("ann", "therapist", "pin")
    assert record.body.subject == "configuration"


@pytest.mark.parametrize("error", [RuntimeError("can't start new thread"), BlockingIOError("no process")])
def test_a_session_for_which_nothing_can_be_started_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def start(_: SessionHost) -> None:
        raise error

    monkeypatch.setattr(SessionHost, "start", start)
    made = make_setup(Home(tmp_path), Config(), DEMO_PATIENT, None, permission=None)
    session = ServedSession(replace(made, linked=True), AtOnce(), held=False)
    session.close_links()
    assert session.ended
    assert session.fault == reason(LinkFault.NOT_STARTED, detail=str(error))


@pytest.mark.parametrize(("name", "lives", "stays"), [("", False, False), ("", True, True), ("other", False, True)])
def test_the_file_of_a_session_whose_own_process_was_killed_goes_with_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, lives: bool, stays: bool
) -> None:
    """It holds the session's key. name: of another session, whose file it is."""
    home = Home(tmp_path)
    made = replace(make_setup(home, Config(), DEMO_PATIENT, None, permission=None), linked=True)
    started = start_of(os.getpid()) if lives else "an earlier boot"
    share(replace(made, session=name or made.session, host_pid=os.getpid(), host_started=started))
    monkeypatch.setattr(SessionHost, "start", lambda _: None)
    session = ServedSession(made, AtOnce(), held=False)
    session.end()
    session.close_links()
    assert home.session_file.exists() is stays
