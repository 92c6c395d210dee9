"""The laptop's end of the link with a stand-in for `rleex joints`: when it ends, and what it asks for then."""

from __future__ import annotations

import os
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace

from app.demo.two_hosts import free_port
from app.ipc import streams
from app.ipc.links import LatestReceiver, OrderedReceiver, OrderedSender, address
from app.ipc.messages import LinkHealth, OperatorCommand, ProcessStatus
from app.ipc.messages import OperatorKind as K
from app.link.beats import LOST_NS, Beats
from app.link.client import SILENT_NS, LinkClient
from app.link.keys import Peer, add_peer, own_key
from app.link.packets import PacketSeal, new_packet_key
from app.link.port import JointsPort
from app.link.questions import Who, encode, here, question_in
from app.link.wire import (
    VERSION,
    FromLaptop,
    Hello,
    LinkFault,
    LinkNotice,
    Packet,
    Refused,
    ToJoints,
    ToLaptop,
    Welcome,
    program,
)
from app.session.setup import make_setup
from app.system.config import Config, JointsConfig
from app.system.paths import Home
from logs.reason import Reason, key_of, reason
from logs.records import Entry, Note, ProcessEnd
from profiles.schema import DEMO_PATIENT

PATIENCE_S, UNATTENDED_S = 30.0, 120.0
WELCOME = Welcome(link=VERSION, program=program(), connection=1, packet_key=new_packet_key())
ALIVE = (ProcessStatus(name="control", pid=1, alive=True, restarts=0, exit_code=None),)
OVER, RUNS = (Refused(reason=reason(fault, session="s")) for fault in (LinkFault.SESSION_OVER, LinkFault.SESSION_RUNS))


class Joints:
    """The exoskeleton's computer: it answers each greeting, the last answer again and again.

    A welcome is followed by the last frame, if there is one; packets and frames are answered while it `runs`.
    """

    def __init__(self, home: Home, laptop: Home, answers: tuple[Welcome | Refused, ...]) -> None:
        number = free_port()
        self.host = f"127.0.0.1:{number}"
        add_peer(home, Peer(name="laptop", public=own_key(laptop).public, paired_at=""))
        add_peer(laptop, Peer(name="joints", public=own_key(home).public, paired_at="", host=self.host))
        self.frames: list[ToJoints] = []
        self.packets: list[Packet] = []
        self.last: ToLaptop | None = None
        self.runs = False
        self._answers = [*answers]
        self._port = JointsPort(home, number)
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def close(self) -> None:
        self._ending.set()
        self._thread.join()
        self._port.close()

    def _serve(self) -> None:
        decode = msgspec.msgpack.Decoder(FromLaptop).decode
        seal, beats = PacketSeal(connection=WELCOME.connection, key=WELCOME.packet_key, at_joints=True), Beats()
        while not self._ending.is_set():
            self._port.wait(20)
            for datagram, where in self._port.packets():
                packet, question, now_ns = seal.open(datagram), question_in(datagram), time.monotonic_ns()
                if isinstance(question, Who):
                    self._port.send_packet(encode(here(question, now_ns, now_ns)), where)
                if packet is not None:
                    self.packets.append(packet)
                if packet is not None and self.runs:
                    beats.take(packet, now_ns)
                    self._port.send_packet(seal.seal(beats.next(now_ns, time.time_ns())), where)
            for identity, _, content in self._port.frames():
                message = decode(content)
                if isinstance(message, Hello):
                    answer = self._answers.pop(0) if len(self._answers) > 1 else self._answers[0]
                    self._port.send_frame(identity, msgspec.msgpack.encode(answer))
                    if self.last is not None and isinstance(answer, Welcome):
                        self._port.send_frame(identity, msgspec.msgpack.encode(self.last))
                else:
                    self.frames.append(message)
                    if self.runs:
                        frame = ToLaptop(
                            number=message.number, acknowledged=message.number, commands=0, processes=ALIVE
                        )
                        self._port.send_frame(identity, msgspec.msgpack.encode(frame))


Begin = Callable[[tuple[Welcome | Refused, ...]], tuple[LinkClient, Joints]]


@pytest.fixture
def begin(tmp_path: Path) -> Iterator[Begin]:
    """A laptop's link to joints that answer so."""
    laptop = Home(tmp_path / "laptop")
    opened: list[Callable[[], None]] = []

    def linked(answers: tuple[Welcome | Refused, ...]) -> tuple[LinkClient, Joints]:
        joints = Joints(Home(tmp_path / "joints"), laptop, answers)
        config = Config(joints=JointsConfig(host=joints.host), unattended_s=UNATTENDED_S)
        made = make_setup(laptop, config, DEMO_PATIENT, None, permission=None)
        setup = replace(made, host_pid=os.getppid())
        link = LinkClient(setup)
        opened.extend((link.close, joints.close, lambda: shutil.rmtree(setup.links.path)))
        return link, joints

    yield linked
    for close in opened:
        close()


def test_without_a_console_it_ends_and_leaves_the_legs_end_to_control(begin: Begin) -> None:
    """Control damps for longer when nobody is there; asked to end, it would not."""
    link, joints = begin((WELCOME,))
    running = threading.Thread(target=link.run)
    running.start()
    deadline = time.monotonic() + PATIENCE_S
    while not joints.frames:
        assert time.monotonic() < deadline, "no frame came"
        time.sleep(0.01)
    link._began_ns -= int(UNATTENDED_S * 1e9)
    running.join(PATIENCE_S)
    assert not running.is_alive()
    assert not any(frame.ends for frame in joints.frames)


@pytest.mark.parametrize("answers", [(OVER,), (WELCOME, OVER), (WELCOME, RUNS), (RUNS, WELCOME, OVER)])
def test_it_ends_with_its_session_and_waits_for_the_end_of_one_before(
    begin: Begin, answers: tuple[Welcome | Refused, ...]
) -> None:
    link, joints = begin(answers)
    link.run()
    assert isinstance(answers[-1], Refused)
    assert link._fault == answers[-1].reason
    assert bool(joints.frames) is (WELCOME in answers)
    assert not any(frame.ends for frame in joints.frames)


def test_the_console_is_told_why_a_session_could_not_start_before_the_link_ends(begin: Begin) -> None:
    """Its end comes within 50 ms of the health that was sent before, which says nothing of it."""
    link, joints = begin((WELCOME,))
    fault = reason(LinkFault.NOT_STARTED, detail="no drives")
    joints.last = ToLaptop(number=1, acknowledged=0, commands=0, ended=True, fault=fault)
    console = LatestReceiver(address(link._setup.links, streams.LINK.name), LinkHealth)
    link._publish(time.monotonic_ns())
    link._health_ns += int(PATIENCE_S * 1e9)  # the next one is not due by itself
    link.run()
    told = []
    while (health := console.receive(0.5)) is not None:
        told.append(health.fault)
    console.close()
    assert told[-1:] == [fault]


@pytest.mark.parametrize("runs_at_once", [True, False])
def test_a_fault_from_before_the_link_is_up_is_over_with_the_first_frame(begin: Begin, runs_at_once: bool) -> None:
    """Either the exoskeleton's computer was switched on late, or its packets came late after its welcome."""
    link, joints = begin((WELCOME,))
    trail = OrderedReceiver(address(link._setup.links, streams.AUDIT.name), Entry)
    console = LatestReceiver(address(link._setup.links, streams.LINK.name), LinkHealth)
    notes: list[Reason] = []

    def one_is_noted() -> bool:
        entry = trail.receive()
        if entry is not None and isinstance(entry.body, Note) and isinstance(entry.body.text, Reason):
            notes.append(entry.body.text)
        return bool(notes)

    joints.runs = runs_at_once
    if runs_at_once:
        link._began_ns = link._awaited_ns = time.monotonic_ns() - SILENT_NS - 1
    running = threading.Thread(target=link.run)
    running.start()
    if not runs_at_once:
        until(lambda: bool(joints.frames), "a frame")
        link._awaited_ns -= SILENT_NS
        until(one_is_noted, "the fault")
        joints.runs = True
    shown: list[LinkHealth] = []
    until(lambda: has_processes(console, shown), "what control's computer says")
    link._began_ns -= int(UNATTENDED_S * 1e9)
    running.join(PATIENCE_S)
    link._session.record(ProcessEnd(pid=0, reason=None))
    notes += noted(trail)
    console.close()
    trail.close()
    assert shown[-1].fault is None
    # of before the link was up; on a host that stands still for long, nobody seems to answer
    assert {one.code for one in notes} <= {key_of(LinkFault.NOT_ADMITTED), key_of(LinkFault.NOBODY_ANSWERS)}
    assert notes


def test_packets_that_come_again_tell_of_no_hold(begin: Begin) -> None:
    """Only the way from there was lost, as far as the laptop can tell: control had its heartbeats."""
    link, _ = begin((WELCOME,))
    trail = OrderedReceiver(address(link._setup.links, streams.AUDIT.name), Entry)
    seal = PacketSeal(connection=WELCOME.connection, key=WELCOME.packet_key, at_joints=True)
    link._welcomed(WELCOME)
    assert link._remote is not None
    for number, at_ns in enumerate((1, LOST_NS + 1, 2 * LOST_NS + 2), 1):
        link._take_packet(link._remote, seal.seal(Packet(number=number, sent_ns=at_ns)), at_ns)
    link._session.record(ProcessEnd(pid=0, reason=None))
    texts = noted(trail)
    trail.close()
    assert texts == [reason(LinkNotice.PACKETS_RETURNED, silent_s=(LOST_NS + 1) / 1e9)]


def noted(trail: OrderedReceiver[Entry]) -> list[Reason]:
    """The notes until the link's process ends."""
    texts = []
    while (entry := trail.receive(PATIENCE_S)) is not None and not isinstance(entry.body, ProcessEnd):
        if isinstance(entry.body, Note) and isinstance(entry.body.text, Reason):
            texts.append(entry.body.text)
    return texts


def has_processes(console: LatestReceiver[LinkHealth], shown: list[LinkHealth]) -> bool:
    health = console.receive()
    shown += [] if health is None else [health]
    return bool(shown and shown[-1].processes)


def until(condition: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, f"{what} did not come"
        time.sleep(0.01)


@pytest.mark.parametrize(
    ("sent", "told"),
    [
        (((K.HEARTBEAT, 1, 10), (K.ACKNOWLEDGE, 1, 20), (K.ACKNOWLEDGE, 2, 30), (K.STOP, 1, 40)), (1, 20)),
        (((K.HEARTBEAT, 1, 10), (K.ACKNOWLEDGE, 1, 20), (K.TAKE_OVER, 2, 30), (K.STOP, 2, 40)), (2, 0)),
    ],
)
def test_a_stop_s_packet_says_when_the_console_of_its_lease_acknowledged_last(
    begin: Begin, sent: tuple[tuple[K, int, int], ...], told: tuple[int, int]
) -> None:
    """An acknowledgement comes by frame, which a STOP after it may overtake; another console's is none of its own."""
    link, joints = begin((WELCOME,))
    console = OrderedSender(address(link._setup.links, streams.OPERATOR.name))
    for number, (kind, lease, sent_ns) in enumerate(sent):
        console.send(OperatorCommand(sequence=number, kind=kind, lease=lease, sent_ns=sent_ns))
    running = threading.Thread(target=link.run)
    running.start()
    deadline = time.monotonic() + PATIENCE_S
    while not any(packet.stops for packet in joints.packets):
        assert time.monotonic() < deadline, "no packet with the STOP came"
        time.sleep(0.01)
    link._began_ns -= int(UNATTENDED_S * 1e9)
    running.join(PATIENCE_S)
    console.close()
    stopped = next(packet for packet in joints.packets if packet.stops)
    assert ([stop.sent_ns for stop in stopped.stops], stopped.lease, stopped.acknowledged_ns) == ([40], *told)
