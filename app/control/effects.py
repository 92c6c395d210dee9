"""What the strongest event in force does to legs and drives, and when the drives are switched off."""

from __future__ import annotations

from msgspec.structs import replace

from app.control.events.table import displaced, walk_ender
from app.control.executor import step_onward, stop_action
from app.control.gait.machine import Change
from app.control.inputs import DriveNotice, DriveOrder
from app.control.running_action import Stage
from app.control.state import ControlState, Tick
from app.ipc.states import Effect, Event, RequestRefusal
from app.ipc.streams import DAMP_NS, NS_PER_MS
from app.motion import follower
from app.motion.follower import Mode
from hal.joints.device import Joint
from logs import records
from logs.reason import Reason, reason

END_HOLD_NS = 400 * NS_PER_MS  # a session that ends holds first, longer than a hold takes; then it damps


def apply_effect(tick: Tick) -> None:
    """Apply the strongest effect in force, before any request is answered."""
    effect = tick.state.effect
    if tick.state.motion.mode is not Mode.DISABLED and not tick.state.streams.powered:
        _lose_power(tick)
    elif effect is Effect.DAMP:
        _interrupt(tick)
        _damp(tick)
    elif effect is Effect.HOLD and tick.state.gait.running is not None:
        _interrupt(tick)
    elif displaced(tick.state.events) and tick.state.gait.running is None:
        tick.change_gait(Change.INTERRUPTED)
    elif effect is Effect.REFUSE and tick.state.gait.walking:
        _end_walk(tick)


def apply_torque_off(tick: Tick) -> None:
    """End what waits for its plan or for power, though it was requested, or is planned, in the same tick."""
    torque_off = tick.drives is DriveOrder.DISABLE or tick.state.torque_off
    if torque_off and tick.state.running is not None:
        _interrupt(tick, reason(RequestRefusal.TORQUE_OFF))


def _damp(tick: Tick) -> None:
    """Ramp to damping; without a ramp what is not held any more, whatever was commanded."""
    state = tick.state
    if state.motion.mode is not Mode.DISABLED:
        tick.unheld = _unheld(state)
        tick.update(motion=follower.ramp_to_damping(state.motion, tick.unheld))
    elif state.streams.powered and tick.drives is not DriveOrder.DISABLE:  # else torque off is under way
        tick.update(motion=follower.start_damped(tick.settings.gains))


def _unheld(state: ControlState) -> frozenset[Joint]:
    """The joints that the guardian has damped or switched off, or that have sunk while they did not answer."""
    in_force = {one.event for one in state.events if one.in_force}
    if Event.GUARDIAN_ACTED in in_force:
        return frozenset(Joint)
    return state.sunk


def _interrupt(tick: Tick, why: Reason | None = None) -> None:
    """End what runs. Legs at rest keep their gait state, unless they will be damped. why: as of `stop_action`."""
    state = tick.state
    planning = state.running is not None and state.running.stage is Stage.PLANNING
    if state.motion.mode is Mode.DISABLED or (planning and state.effect is Effect.HOLD):
        tick.change_gait(Change.ABANDONED)  # nothing has moved yet
    else:
        tick.update(motion=replace(state.motion, onward=step_onward(state)))  # a walk's step ends with the legs moving
        tick.change_gait(Change.INTERRUPTED)
    stop_action(tick, why)


def _lose_power(tick: Tick, why: Reason | None = None) -> None:
    """The drives have no power any more."""
    tick.change_gait(Change.POWER_LOST)
    tick.update(motion=follower.disable(tick.state.motion), torque_off=False)
    stop_action(tick, why)


def _end_walk(tick: Tick) -> None:
    """Gesture 6 would be refused: the running step ends the walk."""
    running = tick.state.running
    event = None if running is None else walk_ender(tick.state.events, running.report.source)
    if running is not None and event is not None and not tick.state.gait.closing:
        tick.change_gait(Change.WALK_CLOSED)
        tick.update(running=replace(running, walk_ended_by=event.reason))


def disable_drives(tick: Tick) -> None:
    """Torque off at the operator's command, after the guardian's or at the session's end, once the joints are damped.

    Before the tick's own command: while the last stiffness is on the drives, a neutral command would be a jump.
    """
    state = tick.state
    guardian = state.streams.guardian
    damped_ns = END_HOLD_NS + DAMP_NS if state.unattended else 0
    ended = state.ending_ns > 0 and tick.now_ns - state.ending_ns >= damped_ns
    followed = guardian is not None and guardian.off and not (state.torque_off or ended)
    if (state.torque_off or ended or followed) and state.motion.fully_damped:
        tick.drives = DriveOrder.DISABLE
        if followed and tick.inputs.drive_error is None:  # once: an order that failed is given again in each tick
            tick.audit.append(records.Note(text=reason(DriveNotice.FOLLOWED_GUARDIAN)))
        _lose_power(tick, reason(RequestRefusal.TORQUE_OFF))
    if state.ending_ns and tick.state.motion.mode is Mode.DISABLED:
        tick.drives = DriveOrder.DISABLE
        tick.finished = True
        tick.audit.extend(tick.state.stop_records)  # no command will be written for them any more
        tick.update(stop_records=())
