"""What may be asked without a key, over UDP: who answers there, and pairing. Plain packets, small answers."""

from __future__ import annotations

import socket
import time
from contextlib import closing

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from app.link.clock import RoundTrip, update
from app.link.keys import joints_at, own_name
from app.link.packets import MAX_BYTES
from app.link.wire import VERSION, LinkFault, program, split_address
from app.system.errors import AppError
from app.system.paths import Home
from logs.reading.errors import UNDECODABLE
from logs.reason import Reason, key_of, reason

PLAIN = 2  # the first byte
ANSWER_S = 2.0
REPEAT_S = 0.2  # a packet may be lost


def resolve(text: str) -> tuple[str, int]:
    """IPv4 address and port of a host. Raises AppError."""
    host, port = split_address(text)
    try:
        found = socket.getaddrinfo(host, port, socket.AF_INET, socket.SOCK_DGRAM)
    except (OSError, UnicodeError) as error:  # an empty label, or one that is too long, is not encoded (IDNA)
        detail = getattr(error, "strerror", "") or str(error)
        raise AppError(LinkFault.UNKNOWN_HOST, host=host, detail=detail) from error
    return str(found[0][4][0]), port


def connected(host: str, where: tuple[str, int]) -> socket.socket:
    """A socket for packets to that address. Raises AppError when this computer has no way there."""
    found = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        found.connect(where)
    except OSError as error:
        found.close()
        raise AppError(LinkFault.UNKNOWN_HOST, host=host, detail=error.strerror or str(error)) from error
    return found


class Who(Struct, frozen=True, kw_only=True, tag="who"):
    """Who is there? `asked_ns` comes back."""

    link: int
    program: str
    asked_ns: int
    padding: bytes = bytes(64)  # an answer is never longer than its question: it amplifies nothing


class Here(Struct, frozen=True, kw_only=True, tag="here"):
    """The exoskeleton's computer."""

    link: int
    program: str
    asked_ns: int
    received_ns: int
    answered_ns: int


class PairBegin(Struct, frozen=True, kw_only=True, tag="pair-begin"):
    """The laptop's half of the exchange."""

    exchange: bytes
    message: bytes
    padding: bytes = bytes(16)


class PairAnswer(Struct, frozen=True, kw_only=True, tag="pair-answer"):
    """The other half."""

    exchange: bytes
    message: bytes


class PairConfirm(Struct, frozen=True, kw_only=True, tag="pair-confirm"):
    """The laptop's name and key, sealed with what both halves make: only the right code makes it."""

    exchange: bytes
    sealed: bytes


class PairDone(Struct, frozen=True, kw_only=True, tag="pair-done"):
    """The exoskeleton's computer's name and key, sealed."""

    exchange: bytes
    sealed: bytes


class PairRefused(Struct, frozen=True, kw_only=True, tag="pair-refused"):
    """No. left: exchanges that the code is still good for; None: there is no code."""

    exchange: bytes
    left: int | None


Question = Who | PairBegin | PairConfirm
Answer = Here | PairAnswer | PairDone | PairRefused
_encoder = msgspec.msgpack.Encoder()
_questions: msgspec.msgpack.Decoder[Question] = msgspec.msgpack.Decoder(Question)
_answers: msgspec.msgpack.Decoder[Answer] = msgspec.msgpack.Decoder(Answer)


def encode(message: Question | Answer) -> bytes:
    """As it is sent."""
    return bytes([PLAIN]) + _encoder.encode(message)


def question_in(datagram: bytes) -> Question | None:
    """What somebody asks; None for everything else."""
    if not datagram or datagram[0] != PLAIN or len(datagram) > MAX_BYTES:
        return None
    try:
        return _questions.decode(datagram[1:])
    except UNDECODABLE:
        return None


def here(asked: Who, received_ns: int, now_ns: int) -> Here:
    """The answer to `Who`."""
    return Here(link=VERSION, program=program(), asked_ns=asked.asked_ns, received_ns=received_ns, answered_ns=now_ns)


class Asking:
    """A socket to one computer that asks again until it is answered."""

    def __init__(self, host: str) -> None:
        """Raises AppError when the address is none, unknown, or not reached from here."""
        self.host = host
        self._socket = connected(host, resolve(host))

    def ask(self, question: Question, limit_s: float = ANSWER_S) -> Answer:
        """The answer. Raises AppError when none comes."""
        deadline = time.monotonic() + limit_s
        while time.monotonic() < deadline:
            answer = self._ask_once(question)
            if answer is not None:
                return answer
        raise AppError(LinkFault.NOBODY_ANSWERS, host=self.host, limit_s=limit_s)

    def close(self) -> None:
        """Release it."""
        self._socket.close()

    def _ask_once(self, question: Question) -> Answer | None:
        until = time.monotonic() + REPEAT_S
        sent = replace(question, asked_ns=time.monotonic_ns()) if isinstance(question, Who) else question
        try:
            self._socket.send(encode(sent))
            while (left_s := until - time.monotonic()) > 0:
                self._socket.settimeout(left_s)
                answer = _answer_in(self._socket.recv(MAX_BYTES + 1))
                if answer is not None and _answers_it(question, answer):
                    return answer
        except TimeoutError:
            return None
        except OSError:  # nobody listens there, yet
            time.sleep(max(0.0, until - time.monotonic()))
        return None


def _answer_in(datagram: bytes) -> Answer | None:
    try:
        return _answers.decode(datagram[1:]) if datagram[:1] == bytes([PLAIN]) else None
    except UNDECODABLE:
        return None


def _answers_it(question: Question, answer: Answer) -> bool:
    if isinstance(question, Who):
        return isinstance(answer, Here) and answer.asked_ns >= question.asked_ns  # to one of its repetitions
    # A question that was repeated is answered twice: the second answer is none to the next question.
    usual = PairAnswer if isinstance(question, PairBegin) else PairDone
    return isinstance(answer, usual | PairRefused) and answer.exchange == question.exchange


class Found(Struct, frozen=True, kw_only=True):
    """Who answers at an address."""

    host: str
    link: int
    program: str
    round_trip_ns: int
    offset_ns: int
    uncertainty_ns: int


def find(host: str, limit_s: float = ANSWER_S) -> Found:
    """Ask who answers. Raises AppError when nobody does."""
    with closing(Asking(host)) as asking:
        answer = asking.ask(Who(link=VERSION, program=program(), asked_ns=time.monotonic_ns()), limit_s)
    assert isinstance(answer, Here)
    trip = RoundTrip(answer.asked_ns, answer.received_ns, answer.answered_ns, time.monotonic_ns())
    clock = update(None, trip).estimate
    return Found(
        host=host,
        link=answer.link,
        program=answer.program,
        round_trip_ns=trip.delay_ns,
        offset_ns=clock.offset_ns,
        uncertainty_ns=clock.uncertainty_ns,
    )


def require_joints(home: Home, host: str) -> Found:
    """The exoskeleton's computer as it answers. Raises AppError: nobody there, another version, not paired."""
    found = find(host)
    check_version(host, found.link, found.program)
    if joints_at(home, host) is None:
        raise AppError(LinkFault.NOT_PAIRED, host=host)
    return found


def check_version(host: str, link: int, theirs: str) -> None:
    """Raises AppError that says which side is older."""
    if link != VERSION:
        fault = LinkFault.OLDER_THERE if link < VERSION else LinkFault.OLDER_HERE
        raise AppError(fault, host=host, here=f"{program()}/{VERSION}", there=f"{theirs}/{link}")


_FROM_THERE = {
    key_of(LinkFault.OLDER_HERE): LinkFault.OLDER_THERE,
    key_of(LinkFault.OLDER_THERE): LinkFault.OLDER_HERE,
}


def as_read_there(why: Reason) -> Reason:
    """A refusal for the other computer's screen: which side is older, it reads from its own side."""
    code = _FROM_THERE.get(why.code)
    if code is None:
        return why
    return reason(code, host=own_name(), here=why.values["there"], there=why.values["here"])


def why_silent(host: str, silent_s: float) -> Reason:
    """Why the link to a computer does not come up: it answers questions and does not admit us, or nobody answers."""
    try:
        find(host)
    except AppError:
        return reason(LinkFault.NOBODY_ANSWERS, host=host, limit_s=silent_s)
    return reason(LinkFault.NOT_ADMITTED, host=host)
