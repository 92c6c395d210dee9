"""Commands over frames that are lost, repeated and reordered: each once, in order."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from app.ipc.messages import OperatorCommand, OperatorKind
from app.link.order import MOST_WAITING, STOPS_A_PACKET, Flight, Inbox, Outbox, WaitingStops
from app.link.wire import FRAMES_IN_FLIGHT, StopMark


def command(number: int) -> OperatorCommand:
    return OperatorCommand(sequence=number, kind=OperatorKind.ARM, sent_ns=number)


@given(
    steps=st.lists(st.tuples(st.integers(0, 3), st.booleans(), st.booleans(), st.integers(0, 5)), max_size=60),
)
def test_each_command_arrives_once_and_in_order(steps: list[tuple[int, bool, bool, int]]) -> None:
    outbox, inbox, given_, taken = Outbox(), Inbox(), 0, []
    frames: list[tuple[int, tuple[OperatorCommand, ...]]] = []
    for new, arrives, acknowledged, repeats in steps:
        for _ in range(new):
            given_ += 1
            assert outbox.add(command(given_))
        frames.append((outbox.first, outbox.next))
        if arrives:
            taken += inbox.take(*frames[-1])
            taken += inbox.take(*frames[max(0, len(frames) - 1 - repeats)])  # an old frame again
        if acknowledged:
            outbox.acknowledge(inbox.count)
    while outbox.next:  # a link that works again
        taken += inbox.take(outbox.first, outbox.next)
        outbox.acknowledge(inbox.count)
    assert [one.sequence for one in taken] == list(range(1, given_ + 1))


def test_a_frame_that_leaves_a_gap_brings_nothing() -> None:
    inbox = Inbox()
    assert inbox.take(3, [command(3)]) == []
    assert inbox.count == 0


def test_a_full_queue_tells() -> None:
    outbox = Outbox()
    assert all(outbox.add(command(number)) for number in range(MOST_WAITING))
    assert not outbox.add(command(0))


def test_an_acknowledged_stop_ends_the_repetition_of_those_before_it_at_that_console() -> None:
    stops = WaitingStops()
    marks = [StopMark(1, number, number) for number in range(1, 13)]
    for mark in (*marks, StopMark(2, 1, 20)):
        stops.add(mark)
    assert [*stops.next] == [*marks[-STOPS_A_PACKET + 1 :], StopMark(2, 1, 20)]
    assert stops.acknowledge(marks[2:11]), "the other computer names but the newest"
    assert stops.acknowledged == marks[10]
    assert [*stops.next] == [marks[11], StopMark(2, 1, 20)]
    assert not stops.acknowledge(marks[2:11]), "it goes on naming them"
    assert stops.acknowledge([StopMark(2, 1, 20)])
    assert [*stops.next] == [marks[11]]


def test_an_acknowledged_stop_of_an_earlier_console_ends_no_repetition_of_a_later_one() -> None:
    stops, earlier, later = WaitingStops(), StopMark(0, 5, 1_000), StopMark(0, 1, 2_000)
    stops.add(later)
    assert not stops.acknowledge([earlier])
    assert [*stops.next] == [later]


def test_few_frames_are_under_way() -> None:
    flight = Flight()
    for number in range(1, FRAMES_IN_FLIGHT + 1):
        assert flight.is_open
        assert flight.send(number) == number
    states = [flight.is_open]
    flight.receive(1, 2, 50)
    states.append(flight.is_open)
    assert states == [False, True]
    assert flight.received == 1


def test_a_stalled_connection_is_known_by_its_oldest_frame() -> None:
    flight = Flight()
    assert flight.waits_ns(1_000) == 0
    flight.send(1_000)
    flight.send(2_000)
    assert flight.waits_ns(5_000) == 4_000
    flight.receive(1, 1, 5_000)
    assert flight.waits_ns(6_000) == 1_000
    flight.receive(2, 2, 7_000)
    assert flight.waits_ns(9_000) == 0


def test_an_acknowledgement_of_what_was_never_sent_counts_for_nothing() -> None:
    flight = Flight()
    flight.send(1)
    flight.receive(1, 99, 2)
    assert flight.acknowledged == 0


def test_a_process_that_resumes_goes_on_where_the_laptop_is() -> None:
    inbox = Inbox(resumed=True)
    assert [one.sequence for one in inbox.take(8, [command(8), command(9)])] == [8, 9]
    assert [one.sequence for one in inbox.take(8, [command(8), command(9), command(10)])] == [10]
