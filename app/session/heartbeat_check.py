"""When the guardian acts: its state from one check of control's heartbeat to the next. Values only."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

from app.ipc import streams
from app.ipc.messages import Heartbeat
from app.ipc.streams import DAMP_NS, NS_PER_MS
from hal.joints.protocol import LEFT_ON_DAMPING_S

ENDING_DAMP_NS = 500 * NS_PER_MS
LATE_CHECK_NS = 12 * NS_PER_MS
MISSED_CHECKS = 2
OFF_NS = 300 * NS_PER_MS
# Longer than control awaits drives: by `hal.joints.can.lifecycle` 1.4 s for torque off, 2.5 s for power.
WAIT_NS = 3_000 * NS_PER_MS


class GuardianAction(Enum):
    """What the guardian does."""

    MONITOR = "monitor"
    DAMP = "damp"
    DAMP_LEFT_ON = "damp left on"  # what has not confirmed that it is off
    SWITCH_OFF = "switch off"


DAMPING_NS = {GuardianAction.DAMP: DAMP_NS, GuardianAction.DAMP_LEFT_ON: round(LEFT_ON_DAMPING_S * 1e9)}


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardianState:
    """Everything that outlives a check."""

    heartbeat: Heartbeat | None = None
    action: GuardianAction = GuardianAction.MONITOR
    since_ns: int = 0
    checked_ns: int = 0
    evaluated_ns: int = 0  # the moment that the newest check evaluated
    missed: int = 0  # moments in a row at which the heartbeat was stale


def check_heartbeat(
    state: GuardianState, heartbeat: Heartbeat | None, now_ns: int, *, ending: bool = False
) -> GuardianState:
    """The state after one check. Once it damps, it goes on until the drives are off, whatever control sends.

    It monitors again after control reports, from then on, that the drives are unpowered. It acts on the second check
    in a row that finds the heartbeat stale. A check that was itself late knows nothing of the last moments, in which
    control may have stood still with it: it evaluates the time of the check before.
    Where control has ended, or is gone, and a drive has not confirmed that it is off, it is switched off once more. It
    may have been out of reach of control's damping, so it is damped before, unless any set-point would power it.
    ending: the session is being closed, and the wearer is not left in damped joints for long.
    """
    if heartbeat is not None and state.heartbeat is not None and heartbeat.at_ns < state.heartbeat.at_ns:
        heartbeat = None  # sent before the newest one
    evaluated_ns = now_ns if now_ns - state.checked_ns <= LATE_CHECK_NS else state.checked_ns
    newest = heartbeat or state.heartbeat
    missed = state.missed + (evaluated_ns > state.evaluated_ns) if _lost(newest, evaluated_ns) else 0
    state = replace(state, heartbeat=newest, checked_ns=now_ns, evaluated_ns=evaluated_ns, missed=missed)
    since_ns = now_ns - state.since_ns
    damping_ns = DAMPING_NS.get(state.action)
    if damping_ns is not None and since_ns > (min(damping_ns, ENDING_DAMP_NS) if ending else damping_ns):
        return replace(state, action=GuardianAction.SWITCH_OFF, since_ns=now_ns)
    if state.action is GuardianAction.MONITOR and newest is not None:
        if missed >= MISSED_CHECKS and newest.enabled:
            return replace(state, action=GuardianAction.DAMP, since_ns=now_ns)
        if missed >= MISSED_CHECKS or (heartbeat is not None and heartbeat.last and heartbeat.unconfirmed):
            return replace(state, action=GuardianAction.DAMP_LEFT_ON, since_ns=now_ns)
    if state.action is GuardianAction.SWITCH_OFF and since_ns > OFF_NS and _unpowered(heartbeat):
        return replace(state, action=GuardianAction.MONITOR)
    return state


def _unpowered(heartbeat: Heartbeat | None) -> bool:
    """Whether control has just reported it; the last heartbeat of one that ends does not count."""
    return heartbeat is not None and not heartbeat.enabled and not heartbeat.last


def needs_guarding(heartbeat: Heartbeat | None) -> bool:
    """Whether the guardian must act once control is silent: a drive is powered, or may be."""
    return heartbeat is not None and (heartbeat.enabled or heartbeat.unconfirmed) and not heartbeat.last


def _lost(heartbeat: Heartbeat | None, now_ns: int) -> bool:
    """Whether control has been silent with the drives powered."""
    if heartbeat is None or not needs_guarding(heartbeat):
        return False
    return now_ns - heartbeat.at_ns > (WAIT_NS if heartbeat.awaits_drives else streams.HEARTBEAT.stale_ms * NS_PER_MS)
