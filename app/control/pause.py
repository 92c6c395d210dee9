"""Pauses: the path's clock stands still for a passing cause and goes on by itself, within a limit over all of them."""

from __future__ import annotations

from msgspec.structs import replace

from app.control.events.table import ROW
from app.control.state import RunningPause, Tick
from app.ipc.states import Action, Effect, PauseCause
from logs import records

LIMIT_NS = 1_000_000_000  # paused for longer than this within WINDOW_NS: the legs are held
WINDOW_NS = 2_000_000_000
# At the program's start, not in the middle of a step: an event that pauses and has no member in PauseCause.
_CAUSE_OF = {
    event: PauseCause(event.value)  # ValueError: give it its member in PauseCause, app/ipc/states.py
    for event, row in ROW.items()
    if row.effect is Effect.PAUSE
}


def paused_too_long(tick: Tick) -> bool:
    """Whether the running pause, with those that it followed, has used up what a pause may take."""
    running = tick.state.pause
    if running is None:
        return False
    since_ns = tick.now_ns - WINDOW_NS
    before_ns = sum(end - max(begin, since_ns) for begin, end in tick.state.recent_pauses if end > since_ns)
    return before_ns + tick.now_ns - max(running.began_ns, since_ns) > LIMIT_NS


def track_pause(tick: Tick) -> None:
    """Begin or end the pause of the running action, as the effect has it."""
    state = tick.state
    paused = state.effect is Effect.PAUSE and state.gait.running is not None
    if paused and state.pause is None:
        tick.update(pause=_begin(tick, state.gait.running))
    elif not paused and state.pause is not None:
        _end(tick, state.pause)


def _begin(tick: Tick, action: Action | None) -> RunningPause:
    """A tick that began late paused the legs for as long already."""
    assert action is not None
    state = tick.state
    return RunningPause(
        cause=next(_CAUSE_OF[one.event] for one in state.events if one.in_force and one.event in _CAUSE_OF),
        began_ns=tick.now_ns - tick.inputs.late_ns,
        action=action,
        state=state.gait.state,
        progress=state.motion.progress,
    )


def _end(tick: Tick, pause: RunningPause) -> None:
    state, now_ns = tick.state, tick.now_ns
    resumed = state.gait.running is not None
    lasted_s = (now_ns - pause.began_ns) / 1e9
    tick.audit.append(
        records.Pause(
            cause=pause.cause.value,
            began_ns=pause.began_ns,
            duration_s=lasted_s,
            state=pause.state.value,
            action=pause.action.value,
            progress=pause.progress,
            resumed=resumed,
        )
    )
    recent = (one for one in state.recent_pauses if one[1] > now_ns - WINDOW_NS)
    summary = state.pauses
    tick.update(
        pause=None,
        recent_pauses=(*recent, (pause.began_ns, now_ns)),
        pauses=replace(
            summary,
            count=summary.count + 1,
            total_s=summary.total_s + lasted_s,
            cause=pause.cause,
            duration_s=lasted_s,
            ended_ns=now_ns,
            resumed=resumed,
        ),
    )
