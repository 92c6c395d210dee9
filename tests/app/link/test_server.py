"""`rleex joints` in this process, on loopback: what must not end it, and what it counts for each session anew."""

from __future__ import annotations

import secrets
import shutil
import socket
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest

from app.demo.two_hosts import free_port
from app.ipc import streams
from app.ipc.links import LatestReceiver, address
from app.ipc.messages import LinkHealth
from app.link import remote as their_end
from app.link import served
from app.link.client import LinkClient
from app.link.keys import Peer, add_peer, own_key, own_name
from app.link.pairing import Offer, new_code, pair, write_offer
from app.link.questions import Answer, Asking, PairBegin, PairConfirm, PairRefused, Who, encode, find
from app.link.remote import Remote
from app.link.server import JointsServer
from app.link.wire import VERSION, Hello, LinkFault, Refused, ToJoints, ToLaptop, Welcome, program
from app.session.setup import make_setup
from app.system.config import Config, JointsConfig, SessionSetup
from app.system.errors import AppError
from app.system.paths import Home
from app.text.catalogue import render
from logs.reason import key_of
from profiles.schema import DEMO_PATIENT

pytestmark = pytest.mark.serial

PATIENCE_S = 30.0
OFF_THE_CURVE = b"A" + bytes(31) + b"\x01"  # a point of side A that spake2 does not find on its curve


class OnlyEnds(Executor):
    """Starts no process of a session; what is asked for after that, its end, is done at once."""

    def __init__(self) -> None:
        self._asked = 0

    def submit(self, call: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        self._asked += 1
        if self._asked > 1:
            call(*args, **kwargs)
        return Future()


class Joints:
    """A server with its home and its address."""

    def __init__(self, home: Home) -> None:
        self.home, self.port = home, free_port()
        self.host = f"127.0.0.1:{self.port}"
        self.server = JointsServer(home, self.port, OnlyEnds())

    def ask(self, question: PairBegin | PairConfirm) -> Answer:
        asking = Asking(self.host)
        try:
            return asking.ask(question, PATIENCE_S)
        finally:
            asking.close()

    def lives(self) -> bool:
        return find(self.host, PATIENCE_S).host == self.host


@contextmanager
def running(home: Home) -> Iterator[Joints]:
    joints = Joints(home)
    failed: list[BaseException] = []

    def run() -> None:
        try:
            joints.server.run()
        except Exception as error:  # noqa: BLE001
            failed.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield joints
    finally:
        joints.server.end()
        thread.join()
        joints.server.close()
    assert failed == []


@pytest.fixture
def joints(tmp_path: Path) -> Iterator[Joints]:
    with running(Home(tmp_path / "joints")) as there:
        yield there


def begin(message: bytes = OFF_THE_CURVE) -> PairBegin:
    return PairBegin(exchange=secrets.token_bytes(16), message=message)


def offer(home: Home) -> None:
    write_offer(home, Offer(code=new_code(), expires_s=time.time() + 60.0))


def paired(joints: Joints, laptop: Home, host: str = "") -> SessionSetup:
    """A laptop that both know, with a session to ask for. host: where the laptop finds them, if elsewhere."""
    host = host or joints.host
    add_peer(joints.home, Peer(name="laptop", public=own_key(laptop).public, paired_at=""))
    add_peer(laptop, Peer(name="joints", public=own_key(joints.home).public, paired_at="", host=host))
    config = Config(joints=JointsConfig(host=host))
    setup = make_setup(laptop, config, DEMO_PATIENT, None, permission=None)
    setup.links.path.rmdir()
    return setup


def greeted(setup: SessionSetup) -> Welcome | Refused:
    """What the laptop is answered."""
    with closing(Remote(setup)) as remote:
        remote.connect(time.monotonic_ns())
        for message in messages(remote):
            if isinstance(message, Welcome | Refused):
                return message
    raise AssertionError("nobody answered the greeting")


def messages(remote: Remote) -> Iterator[Welcome | Refused | ToLaptop]:
    """What comes within PATIENCE_S."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        remote.poller.poll(20)
        yield from remote.frames(time.monotonic_ns())


@pytest.mark.parametrize(
    "datagram",
    [
        encode(Who(link=VERSION, program="AAAA", asked_ns=1)).replace(b"AAAA", b"\xff\xfe\xff\xfe"),
        b"\x02\x82\xa4type\xa3who\xa1x" + b"\x91" * 1000 + b"\x01",
    ],
    ids=["no UTF-8", "nested too deeply"],
)
def test_a_packet_that_can_not_be_decoded_ends_nothing(joints: Joints, datagram: bytes) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as foreign:
        foreign.sendto(datagram, ("127.0.0.1", joints.port))
    assert joints.lives()


def test_a_laptop_is_told_that_the_session_is_over_when_the_command_ends(joints: Joints, tmp_path: Path) -> None:
    with closing(Remote(paired(joints, Home(tmp_path / "laptop")))) as remote:
        remote.connect(time.monotonic_ns())
        ended = False
        for message in messages(remote):
            if isinstance(message, ToLaptop):
                joints.server.end()  # just after a frame: the next one is not due yet
                number = remote.flight.send(time.monotonic_ns())
                remote.send(ToJoints(number=number, acknowledged=remote.flight.received))
                ended = message.ended
            if ended:
                break
    assert ended


def test_a_session_that_ends_before_the_first_packet_ends_there_as_well(
    joints: Joints, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Remote, "send_packet", lambda *_: None)
    setup = paired(joints, Home(tmp_path / "laptop"))
    setup.links.path.mkdir(mode=0o700)
    with closing(LinkClient(setup)) as link:
        link.end()
        link.run()
    assert joints.server._session is not None
    assert joints.server._session.ended
    shutil.rmtree(setup.links.path)


def test_a_malformed_half_of_a_pairing_is_refused_and_costs_one_exchange(joints: Joints) -> None:
    offer(joints.home)
    answer = joints.ask(begin())
    assert isinstance(answer, PairRefused)
    assert answer.left == 2
    assert joints.lives()


def test_an_offer_that_can_not_be_kept_is_refused(joints: Joints) -> None:
    offer(joints.home)
    (joints.home.link_keys / "offer.json.partial").mkdir()  # as on a full disk: nothing new can be written
    answer = joints.ask(begin())
    assert isinstance(answer, PairRefused)
    assert joints.lives()


def test_pairing_with_a_damaged_list_of_peers_is_refused(joints: Joints, tmp_path: Path) -> None:
    code = new_code()
    write_offer(joints.home, Offer(code=code, expires_s=time.time() + 60.0))
    damage_peers(joints.home)
    with pytest.raises(AppError) as refused:
        pair(Home(tmp_path / "laptop"), joints.host, code, time.time())
    assert refused.value.code is LinkFault.NO_CODE
    assert joints.lives()


def test_a_list_of_peers_damaged_in_a_session_does_not_end_it(
    joints: Joints, tmp_path: Path, health: Callable[[], LatestReceiver[LinkHealth]]
) -> None:
    assert isinstance(greeted(paired(joints, Home(tmp_path / "laptop"))), Welcome)
    damage_peers(joints.home)
    after_ns = time.monotonic_ns()
    told = until(health(), lambda now: now.at_ns > after_ns)
    assert told.host == "laptop"


def test_a_session_that_can_not_be_begun_is_refused(
    joints: Joints, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    setup = paired(joints, Home(tmp_path / "laptop"))
    with monkeypatch.context() as full:
        full.setattr("tempfile.tempdir", str(tmp_path / "gone"))  # where the session's sockets would be
        refused = greeted(setup)
    assert isinstance(refused, Refused)
    assert refused.reason.code == key_of(LinkFault.NOT_STARTED)
    assert joints.lives()


def test_each_session_begins_with_the_configuration_as_the_file_is_then(joints: Joints, tmp_path: Path) -> None:
    """The service runs for months; a stop button that was added since must count."""
    setup = paired(joints, Home(tmp_path / "laptop"))
    for broken in ('unattended_s = "soon"', f'[joints]\nhost = "{joints.host}"'):
        joints.home.config.write_text(broken, encoding="utf-8")
        assert isinstance(greeted(setup), Refused)
    joints.home.config.write_text(
        'unattended_s = 20.0\n[[inputs]]\nname = "pendant"\nrole = "wearer"\nkind = "simulated"\n', encoding="utf-8"
    )
    assert isinstance(greeted(setup), Welcome)
    assert joints.server._session is not None
    config = joints.server._session._host.setup.config
    assert (config.unattended_s, [one.name for one in config.inputs]) == (20.0, ["pendant"])


def test_a_laptop_is_told_whose_file_is_broken(joints: Joints, tmp_path: Path) -> None:
    setup = paired(joints, Home(tmp_path / "laptop"))
    joints.home.config.write_text('unattended_s = "soon"', encoding="utf-8")
    refused = greeted(setup)
    assert isinstance(refused, Refused)
    assert refused.reason.code == key_of(LinkFault.NOT_STARTED)
    assert render(refused.reason).startswith("The exoskeleton's computer could not start the session: The config")


class OtherHello(Hello, frozen=True, kw_only=True, tag="hello", rename={"request": "wanted"}):
    """A greeting that has in common with this version's what every version's has."""


@pytest.mark.parametrize("greeting", [Hello, OtherHello])
@pytest.mark.parametrize("theirs", [VERSION - 1, VERSION + 1])
def test_a_laptop_of_another_version_is_told_which_side_is_older_as_it_is_read_there(
    joints: Joints, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, theirs: int, greeting: type[Hello]
) -> None:
    setup = paired(joints, Home(tmp_path / "laptop"))
    monkeypatch.setattr(their_end, "VERSION", theirs)
    monkeypatch.setattr(their_end, "Hello", greeting)
    refused = greeted(setup)
    assert isinstance(refused, Refused)
    assert refused.reason.code == key_of(LinkFault.OLDER_HERE if theirs < VERSION else LinkFault.OLDER_THERE)
    versions = {"here": f"{program()}/{theirs}", "there": f"{program()}/{VERSION}"}
    assert refused.reason.values == {"host": own_name(), **versions}


def test_foreign_peers_from_before_a_session_are_none_of_its(
    joints: Joints, tmp_path: Path, health: Callable[[], LatestReceiver[LinkHealth]]
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as foreign:
        for _ in range(5):
            foreign.sendto(b"\0 nothing of ours", ("127.0.0.1", joints.port))
        assert joints.lives(), "it answers what was sent after them"
        assert isinstance(greeted(paired(joints, Home(tmp_path / "laptop"))), Welcome)
        assert until(health(), lambda now: bool(now.host)).foreign_peers == 0
        foreign.sendto(b"\0 nothing of ours", ("127.0.0.1", joints.port))
        assert until(health(), lambda now: bool(now.foreign_peers)).foreign_peers == 1


@pytest.fixture
def health(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], LatestReceiver[LinkHealth]]]:
    """What the server tells control of the session that it has begun."""
    made: list[SessionSetup] = []
    opened: list[LatestReceiver[LinkHealth]] = []

    def making(*args: Any, **kwargs: Any) -> SessionSetup:
        made.append(make_setup(*args, **kwargs))
        return made[-1]

    def receiver() -> LatestReceiver[LinkHealth]:
        opened.append(LatestReceiver(address(made[-1].links, streams.LINK.name), LinkHealth))
        return opened[-1]

    monkeypatch.setattr(served, "make_setup", making)
    yield receiver
    for one in opened:
        one.close()


def until(link: LatestReceiver[LinkHealth], condition: Callable[[LinkHealth], bool]) -> LinkHealth:
    """The first health for which it holds."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        now = link.receive(0.05)
        if now is not None and condition(now):
            return now
    raise AssertionError("the server tells nothing like it")


def damage_peers(home: Home) -> None:
    path = home.link_keys / "peers.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("{")
