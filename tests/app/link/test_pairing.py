"""Pairing by a code over real sockets of loopback: right, wrong, used up, too old, typed badly; nobody there."""

from __future__ import annotations

import re
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from msgspec.structs import replace

from app.link import pairing
from app.link.keys import Peer, add_peer, forget_peer, joints_at, own_key, peers_of
from app.link.pairing import Offer, PairingDesk, pair, write_offer
from app.link.questions import (
    REPEAT_S,
    Answer,
    PairAnswer,
    PairBegin,
    PairConfirm,
    PairRefused,
    Who,
    check_version,
    encode,
    find,
    here,
    question_in,
    why_silent,
)
from app.link.wire import VERSION, LinkFault
from app.system.errors import AppError
from app.system.paths import Home
from app.text.catalogue import render
from logs.reason import key_of

CODE = "1234-5678"


@dataclass
class Joints:
    """The exoskeleton's computer, as far as pairing needs it."""

    home: Home
    host: str = ""
    begun: list[PairBegin] = field(default_factory=list)
    malformed: bytes = b""  # instead of its half of an exchange
    answers: int = 1  # to each packet, as when it was repeated
    lost: int = 0  # packets that still get lost on their way

    def answer(self, datagram: bytes) -> bytes | None:
        if self.lost:
            self.lost -= 1
            return None
        question, now_ns = question_in(datagram), time.monotonic_ns()
        desk = self._desk
        reply: Answer
        if isinstance(question, Who):
            reply = here(question, now_ns, time.monotonic_ns())
        elif isinstance(question, PairBegin):
            self.begun.append(question)
            reply = desk.begin(question, time.time())
            if self.malformed and isinstance(reply, PairAnswer):
                reply = replace(reply, message=self.malformed)
        elif isinstance(question, PairConfirm):
            reply = desk.confirm(question, time.time())
        else:
            return None
        return encode(reply)

    def __post_init__(self) -> None:
        self._desk = PairingDesk(self.home)

    def offer(self, left: int = pairing.EXCHANGES, lasts_s: float = 60.0) -> None:
        write_offer(self.home, Offer(code=CODE, expires_s=time.time() + lasts_s, left=left))


class Late(Joints):
    """Its answer to each question comes after that has been repeated."""

    _before: bytes = b""

    def answer(self, datagram: bytes) -> bytes | None:
        before, self._before = self._before, datagram
        return super().answer(before)


@contextmanager
def answering(joints: Joints) -> Iterator[Joints]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        udp.bind(("127.0.0.1", 0))
        udp.settimeout(0.05)
        joints.host = f"127.0.0.1:{udp.getsockname()[1]}"
        ending = threading.Event()

        def serve() -> None:
            while not ending.is_set():
                try:
                    datagram, where = udp.recvfrom(2048)
                except TimeoutError:
                    continue
                reply = joints.answer(datagram)
                for _ in range(joints.answers if reply is not None else 0):
                    udp.sendto(reply or b"", where)

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield joints
        finally:
            ending.set()
            thread.join()


@pytest.fixture
def joints(tmp_path: Path) -> Iterator[Joints]:
    with answering(Joints(Home(tmp_path / "joints"))) as there:
        yield there


@pytest.fixture
def laptop(tmp_path: Path) -> Home:
    return Home(tmp_path / "laptop")


def refusal(laptop: Home, joints: Joints, code: str = CODE) -> str:
    with pytest.raises(AppError) as refused:
        pair(laptop, joints.host, code, time.time())
    assert render(refused.value)
    assert peers_of(laptop) == ()
    return str(refused.value.code.name)


def test_the_right_code_tells_each_side_the_others_key_once(laptop: Home, joints: Joints) -> None:
    joints.offer()
    pair(laptop, joints.host, "1234 5678", time.time())
    (there,) = peers_of(joints.home)
    assert there.public == own_key(laptop).public
    found = joints_at(laptop, joints.host)
    assert found is not None
    assert found.public == own_key(joints.home).public
    with pytest.raises(AppError) as refused:
        pair(laptop, joints.host, CODE, time.time())
    assert refused.value.code is LinkFault.NO_CODE


def test_a_wrong_code_tells_how_often_it_may_be_tried_and_is_then_used_up(laptop: Home, joints: Joints) -> None:
    joints.offer()
    faults = [refusal(laptop, joints, "0000-0000") for _ in range(pairing.EXCHANGES)]
    assert faults == ["CODE_WRONG", "CODE_WRONG", "CODE_USED_UP"]
    assert refusal(laptop, joints) == "CODE_USED_UP", "the right one comes too late"
    assert peers_of(joints.home) == ()


def test_an_exchange_without_an_end_costs_one_as_well(laptop: Home, joints: Joints) -> None:
    joints.offer(left=1)
    assert refusal(laptop, joints, "0000-0000") == "CODE_USED_UP"
    joints.offer(left=0)
    assert refusal(laptop, joints) == "CODE_USED_UP"


def test_an_old_code_and_none_are_refused(laptop: Home, joints: Joints) -> None:
    assert refusal(laptop, joints) == "NO_CODE"
    joints.offer(lasts_s=-1.0)
    assert refusal(laptop, joints) == "NO_CODE"


@pytest.mark.parametrize("code", ["", "1234", "1234-56789", "abcd-efgh", "１２３４５６７８"])
def test_what_is_no_code_is_refused_before_anything_is_sent(laptop: Home, joints: Joints, code: str) -> None:
    assert refusal(laptop, joints, code) == "CODE_MALFORMED"
    assert joints.begun == []


MALFORMED = [bytes(31) + b"\x01", bytes(31) + b"\x02", bytes(32), bytes(7)]  # not on the curve, no element, short


@pytest.mark.parametrize("point", MALFORMED, ids=bytes.hex)
def test_a_malformed_half_is_refused_on_both_sides(laptop: Home, joints: Joints, point: bytes) -> None:
    joints.offer()
    begun = PairBegin(exchange=bytes(16), message=b"A" + point)
    assert PairingDesk(joints.home).begin(begun, time.time()) == PairRefused(exchange=bytes(16), left=2)
    joints.malformed = b"B" + point
    assert refusal(laptop, joints) == "CODE_USED_UP"


def test_a_repeated_packet_costs_nothing(laptop: Home, joints: Joints) -> None:
    joints.offer()
    pair(laptop, joints.host, CODE, time.time())
    (begun,) = joints.begun
    again = joints.answer(encode(begun))
    assert again is not None


def test_a_slow_way_on_which_questions_are_repeated_pairs(laptop: Home, joints: Joints) -> None:
    joints.offer()
    joints.answers = 2
    pair(laptop, joints.host, CODE, time.time())
    assert len(peers_of(joints.home)) == len(peers_of(laptop)) == 1


def test_keys_are_readable_by_their_owner_alone(laptop: Home, joints: Joints) -> None:
    joints.offer()
    pair(laptop, joints.host, CODE, time.time())
    for home in (laptop, joints.home):
        assert [folder.stat().st_mode & 0o077 for folder in (home.keys, home.link_keys)] == [0, 0]
        assert all(path.stat().st_mode & 0o077 == 0 for path in home.link_keys.iterdir())


def test_who_answers_is_found_with_its_clock(joints: Joints) -> None:
    found = find(joints.host)
    assert found.link == VERSION
    assert abs(found.offset_ns) <= found.uncertainty_ns, "the same clock"


def test_the_round_trip_is_that_of_the_question_that_is_answered_not_of_a_lost_one_before(joints: Joints) -> None:
    joints.lost = 1
    found = find(joints.host)
    assert found.round_trip_ns < REPEAT_S * 1e9
    assert abs(found.offset_ns) <= found.uncertainty_ns


def test_an_answer_that_takes_longer_than_a_repetition_is_one(tmp_path: Path) -> None:
    with answering(Late(Home(tmp_path / "joints"))) as there:
        found = find(there.host)
    assert found.round_trip_ns >= 0.9 * REPEAT_S * 1e9


def test_nobody_answers(tmp_path: Path) -> None:
    with pytest.raises(AppError) as refused:
        find("127.0.0.1:9", limit_s=0.3)
    assert refused.value.code is LinkFault.NOBODY_ANSWERS


def test_a_computer_that_answers_and_does_not_admit_is_not_called_silent(joints: Joints) -> None:
    assert why_silent(joints.host, 5.0).code == key_of(LinkFault.NOT_ADMITTED)
    assert why_silent("127.0.0.1:9", 5.0).code == key_of(LinkFault.NOBODY_ANSWERS)


@pytest.mark.parametrize("address", ["", "exo local", "exo:", "exo:0", "exo:70000", "exo:1:2", "-exo", "tcp://exo:1"])
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(AppError) as refused:
        find(address)
    assert refused.value.code is LinkFault.BAD_ADDRESS


def test_the_older_side_is_named() -> None:
    check_version("exo", VERSION, "1")
    for link, fault in ((VERSION - 1, LinkFault.OLDER_THERE), (VERSION + 1, LinkFault.OLDER_HERE)):
        with pytest.raises(AppError) as refused:
            check_version("exo", link, "1")
        assert refused.value.code is fault


def test_forgetting_takes_one_away(laptop: Home) -> None:
    for name in ("one", "two"):
        add_peer(laptop, Peer(name=name, public=name, paired_at="", host=f"{name}:7447"))
    assert forget_peer(laptop, "two:7447").name == "two"
    assert [peer.name for peer in peers_of(laptop)] == ["one"]
    with pytest.raises(AppError) as refused:
        forget_peer(laptop, "two")
    assert refused.value.code is LinkFault.NO_SUCH_PEER


def test_of_two_with_one_name_the_fingerprint_tells_which_is_forgotten(tmp_path: Path) -> None:
    home, keys = Home(tmp_path), ("-x7&Qb$1" + "A" * 32, "b(7&Qb$1" + "A" * 32)
    for key in keys:
        add_peer(home, Peer(name="laptop", public=key, paired_at=""))
    shown = peers_of(home)[1].fingerprint
    assert re.fullmatch("[0-9a-f]{8}", shown), "to be typed in any shell"
    for name, fault in (("laptop", LinkFault.AMBIGUOUS_PEER), (shown[:7], LinkFault.NO_SUCH_PEER)):
        with pytest.raises(AppError) as refused:
            forget_peer(home, name)
        assert refused.value.code is fault
        assert [peer.public for peer in peers_of(home)] == [*keys], "nobody is forgotten"
    assert forget_peer(home, shown).public == keys[1]
    assert forget_peer(home, "laptop").public == keys[0]


@pytest.mark.parametrize("address", ["exo.local", "exo.local:7447", "EXO.local"])
def test_one_address_is_found_however_it_is_written(laptop: Home, address: str) -> None:
    for key, host in (("k1", "exo.local:7448"), ("k2", "exo.local:7447"), ("k3", "Exo.local")):
        add_peer(laptop, Peer(name="exo", public=key, paired_at="", host=host))
    found = joints_at(laptop, address)
    assert found is not None
    assert found.public == "k3"
    assert [peer.public for peer in peers_of(laptop)] == ["k1", "k3"], "the newer pairing takes the older one's place"
