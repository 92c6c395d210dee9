"""The watch on a drive's ranges finds a wrong velocity range, and takes no stall of host, bus or drives for one."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum, auto

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.joints.can.range_check import RangeCheck
from hal.joints.protocol import DriveFault

TICK_NS = 2_000_000
SECONDS = 6.0  # of motion; twice as long as the slowest verdict below takes
WRONG = (50 / 22.5, 22.5 / 50, 50 / 25.64, 25.64 / 50, 1.5, 1 / 1.5)  # other firmware of the AK80-9, and the bound


class Stall(Enum):
    """What a stall does to the replies that it meets."""

    SILENT = auto()  # they are lost
    HELD_UP = auto()  # the first one comes at its end, still with the old angle; the others are lost
    IN_A_ROW = auto()  # all come at its end, one shortly after the other
    READ_LATE = auto()  # all carry the time when the host came to read them


@dataclass(frozen=True)
class Trouble:
    """One stall, ns."""

    kind: Stall
    begin_ns: int
    length_ns: int

    def arrival_ns(self, sent_ns: int) -> int | None:
        """When a reply of this time comes; None: never."""
        into_ns = sent_ns - self.begin_ns
        if not 0 <= into_ns < self.length_ns:
            return sent_ns
        end_ns = self.begin_ns + self.length_ns
        return {
            Stall.SILENT: None,
            Stall.HELD_UP: end_ns if into_ns < TICK_NS else None,
            Stall.IN_A_ROW: end_ns + into_ns // 10,
            Stall.READ_LATE: end_ns,
        }[self.kind]


@st.composite
def troubles(draw: st.DrawFn) -> list[Trouble]:
    """Stalls of up to 100 ms one after the other, with 50 ms to a second of peace between them."""
    found, now_ns = [], 0
    while now_ns < SECONDS * 1e9:
        now_ns += draw(st.integers(50_000_000, 1_000_000_000))
        found.append(Trouble(draw(st.sampled_from(Stall)), now_ns, draw(st.integers(1_000_000, 100_000_000))))
        now_ns += found[-1].length_ns
    return found


Swing = tuple[float, float, float]  # amplitude in rad, rate in Hz, phase
WALKING = st.tuples(st.floats(0.25, 0.5), st.floats(0.5, 2.0), st.floats(0.0, math.tau))
BESIDE = st.lists(st.tuples(st.floats(0.0, 0.1), st.floats(0.2, 3.0), st.floats(0.0, math.tau)), max_size=2)


def replies(
    motion: list[Swing], stalls: list[Trouble], jitter_ns: list[int], lost: list[bool]
) -> Iterator[tuple[float, float, int]]:
    """Angle, velocity and arrival of what comes from an AK80-64, in the order of arrival."""
    came = []
    for number, sent_ns in enumerate(range(TICK_NS, int(SECONDS * 1e9), TICK_NS)):
        trouble = next((one for one in stalls if one.begin_ns <= sent_ns < one.begin_ns + one.length_ns), None)
        arrival_ns = sent_ns if trouble is None else trouble.arrival_ns(sent_ns)
        if arrival_ns is not None and not lost[number % len(lost)]:
            came.append((arrival_ns + jitter_ns[number % len(jitter_ns)], sent_ns))
    for arrival_ns, sent_ns in sorted(came):
        angle = sum(size * math.sin(math.tau * hz * sent_ns / 1e9 + phase) for size, hz, phase in motion)
        speed = sum(
            size * math.tau * hz * math.cos(math.tau * hz * sent_ns / 1e9 + phase) for size, hz, phase in motion
        )
        yield math.floor(angle * 65535 / 25) * 25 / 65535, math.floor(speed * 4095 / 16) * 16 / 4095, arrival_ns


JITTER = st.lists(st.integers(0, 3_000_000), min_size=1, max_size=40)
LOST = st.lists(st.sampled_from((False, False, False, True)), min_size=1, max_size=40).filter(
    lambda lost: not all(lost)
)


@settings(max_examples=60)
@given(leg=WALKING, beside=BESIDE, stalls=troubles(), jitter_ns=JITTER, lost=LOST)
def test_right_ranges_are_never_reported_wrong(
    leg: Swing, beside: list[Swing], stalls: list[Trouble], jitter_ns: list[int], lost: list[bool]
) -> None:
    watch = RangeCheck()
    for angle, speed, at_ns in replies([leg, *beside], stalls, jitter_ns, lost):
        assert watch.check(angle, speed, at_ns) is DriveFault.NONE


@settings(max_examples=30)
@given(leg=WALKING, share=st.sampled_from(WRONG), jitter_ns=JITTER, begin_ns=st.integers(0, 1_000_000_000))
def test_wrong_ranges_are_always_reported(leg: Swing, share: float, jitter_ns: list[int], begin_ns: int) -> None:
    """Beside a stall a second, whatever it does to the replies."""
    stalls = [
        Trouble(tuple(Stall)[number % 4], begin_ns + number * 1_000_000_000, 60_000_000)
        for number in range(int(SECONDS))
    ]
    watch = RangeCheck()
    coming = replies([leg], stalls, jitter_ns, [False])
    assert any(watch.check(angle, share * speed, at_ns) is DriveFault.WRONG_RANGE for angle, speed, at_ns in coming)


def judged(*, share: float, silent_ms: float = 0.0, seconds: float = 3.0) -> DriveFault:
    """A leg swings ±0.3 rad at 3 Hz; velocities come scaled by `share`, and in every 50 ms there is a silence."""
    watch, verdict = RangeCheck(), DriveFault.NONE
    for now_ns in range(0, int(seconds * 1e9), TICK_NS):
        if now_ns % 50_000_000 < silent_ms * 1e6:
            continue
        phase = 2 * math.pi * 3.0 * now_ns / 1e9
        velocity = 0.3 * 2 * math.pi * 3.0 * math.cos(phase)
        verdict = watch.check(0.3 * math.sin(phase), share * velocity, now_ns)
    return verdict


@pytest.mark.parametrize("silent_ms", [0.0, 8.0, 14.0, 20.0, 30.0, 45.0])
def test_silences_of_a_swinging_leg_are_no_wrong_range(silent_ms: float) -> None:
    assert judged(share=1.0, silent_ms=silent_ms) is DriveFault.NONE


@pytest.mark.parametrize("share", WRONG)
@pytest.mark.parametrize("silent_ms", [0.0, 8.0])
def test_wrong_ranges_are_found_within_half_a_second_of_brisk_motion(share: float, silent_ms: float) -> None:
    assert judged(share=share, silent_ms=silent_ms, seconds=0.5) is DriveFault.WRONG_RANGE


def test_an_old_angle_with_a_fresh_time_after_each_gap_is_no_wrong_range() -> None:
    """Drives that stood still for 30 ms, emulated ones or a host's, answer first with where the leg was."""
    watch = RangeCheck()
    for number in range(60):
        for now_ms in range(0, 100, 2):
            at_ms = number * 130 + now_ms
            seen_ms = at_ms - 30 if now_ms == 0 else at_ms
            assert watch.check(seen_ms * 1e-3, 1.0, at_ms * 1_000_000 + 1) is DriveFault.NONE


def test_a_leg_at_rest_proves_nothing() -> None:
    watch = RangeCheck()
    verdicts = {watch.check(0.1, 0.02, now_ns) for now_ns in range(0, 2_000_000_000, TICK_NS)}
    assert verdicts == {DriveFault.NONE}
