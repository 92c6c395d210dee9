"""What a host that stands still makes control say, and a flow that begins anew because of it."""

from __future__ import annotations

import functools
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from app.ipc.states import Event

SESSIONS = 5  # times that a flow may be begun because the guardian took the legs of a stalling host
# What control says when the host stood still; nothing else makes it say so over simulated joints.
STALLS = frozenset(
    {
        Event.CONTROL_STALLED,
        Event.HOST_SUSPENDED,
        Event.JOINT_TIMEOUT,
        Event.CONSOLE_TIMEOUT,
        Event.PLANNER_TIMEOUT,
        Event.NEXT_STEP_MISSING,
        Event.PAUSE_TOO_LONG,  # a console without a terminal has its heartbeat from the event loop, at no priority
    }
)
# What may follow where a stall has held the legs in mid-movement.
AFTER_STALLS = frozenset({Event.FAR_FROM_POSE, Event.FOLLOWING_LIMIT, Event.UNEXPECTED_MOTION})

Flow = Callable[[Path], Awaitable[None]]


class HostStalled(Exception):  # noqa: N818 - no error: the machine was busy
    """The host stood still for so long that this session can't go on."""


def walked_again(flow: Flow) -> Flow:
    """A flow that begins anew, in a home of its own, when a stalling host has cost it its session."""

    @functools.wraps(flow)
    async def walk(tmp_path: Path) -> None:
        stalls = []
        for number in range(SESSIONS):
            try:
                await flow(tmp_path / str(number))
            except HostStalled as stall:
                stalls.append(str(stall))
            else:
                return
        pytest.fail(f"the host stalled in every session: {stalls}")

    return walk
