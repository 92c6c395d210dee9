"""Guidance for the operator: the checks before arming, and the next step in one sentence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import partial

from app.console.state import SessionState
from app.console.widgets.curves import SILENT_MS, joint_fault
from app.console.widgets.panel import Lines, plain
from app.ipc.messages import ProcessStatus
from app.ipc.snapshot import ControlSnapshot
from app.ipc.states import ACTION_OF, Effect, Event, GaitState
from app.system.vocabulary import VocabularyStatus
from app.text.catalogue import tr


class Light(Enum):
    """How a check stands: shape, and a colour that only repeats it."""

    GREEN = "✓"
    WAITING = "…"
    AMBER = "!"
    RED = "✗"


@dataclass(frozen=True, slots=True)
class Check:
    """A name of the language file, and the test; `must` ones keep the session from being armed."""

    name: str
    passes: Callable[[SessionState], bool]
    must: bool = True
    operator: bool = False  # waits for the operator, not for a machine
    applies: Callable[[SessionState], bool] = lambda _: True
    for_keys: Callable[[SessionState], bool] | None = None  # what the therapist's keys need of it; None: all


def _press_zone(state: SessionState) -> bool:
    report = state.report
    return report is None or report.press_zone is None or report.press_zone.fits(report.threshold_m)


def _pressed_once(state: SessionState) -> bool:
    inputs = state.snapshot.stop_inputs if state.snapshot is not None else ()
    return bool(inputs) and all(one.pressed_once for one in inputs)


RECORDERS = {"recording", "bus-log"}  # the legs go on without them


def _recorders(state: SessionState) -> list[ProcessStatus]:
    return [one for one in state.all_processes if one.name in RECORDERS]


def _processes_run(state: SessionState, besides: str = "") -> bool:
    needed = [one for one in state.all_processes if one.name not in RECORDERS]
    return len(needed) >= 5 and not state.misses_process and all(one.alive or one.name == besides for one in needed)


CHECKS = (
    Check("processes", _processes_run, for_keys=partial(_processes_run, besides="perception")),
    Check(
        "recorders",
        lambda state: all(one.alive for one in _recorders(state)),
        must=False,
        applies=lambda state: bool(_recorders(state)),
    ),
    Check("audit", lambda state: state.audit is not None and not state.audit.fault and not state.audit_silent),
    Check("control", lambda state: state.snapshot_fresh),
    Check("joints", lambda state: state.snapshot is not None and not any(map(joint_fault, state.snapshot.joints))),
    Check(
        "camera",
        lambda state: state.report_fresh and state.report is not None and not state.report.camera_fault,
        for_keys=lambda _: True,
    ),
    Check("clear", lambda state: state.snapshot is not None and state.snapshot.effect < Effect.HOLD),
    Check("press_zone", _press_zone, must=False),
    Check(
        "vocabulary",
        lambda state: state.vocabulary is VocabularyStatus.VALID,
        must=False,
        applies=lambda state: state.vocabulary is not VocabularyStatus.NOT_NEEDED,
    ),
    Check(
        "preflight",
        lambda state: state.snapshot is not None and not state.snapshot.uncleared,
        must=False,
        applies=lambda state: not state.simulated,
    ),
    Check("real_time", lambda state: state.snapshot is not None and state.snapshot.real_time.fifo, must=False),
    Check("no_stop_input", lambda _: False, must=False, applies=lambda state: not state.has_stop_inputs),
    Check("stop_inputs", _pressed_once, operator=True, applies=lambda state: state.has_stop_inputs),
    Check("patient", lambda state: state.snapshot is not None and state.snapshot.patient_confirmed, operator=True),
)


def results(state: SessionState) -> dict[str, Light]:
    """Every check as it stands now, by its name."""
    return {check.name: _light(check, state) for check in CHECKS if check.applies(state)}


def ready(state: SessionState) -> bool:
    """Whether everything that the therapist's keys need is there; what only gestures need, events tell."""
    return all((check.for_keys or check.passes)(state) for check in CHECKS if check.must and check.applies(state))


def _light(check: Check, state: SessionState) -> Light:
    if check.passes(state):
        return Light.GREEN
    if not check.must and state.snapshot is not None:
        return Light.AMBER
    if check.operator or state.starting:
        return Light.WAITING
    return Light.RED


ENDINGS = {Event.SHUTTING_DOWN, Event.SHUTDOWN_DAMPING}


def guidance_line(state: SessionState, keys: dict[str, str], *, watching: bool = False) -> Lines:
    """One line; `keys` maps a key's name in the key table to how it is shown."""
    name, style = next_step(state)
    if watching:
        return (plain(f"· {tr(f'watch.{name}', **keys)}", style),)
    return (plain(f"▶ {tr(f'guide.{name}', **keys)}", style),)


def next_step(state: SessionState) -> tuple[str, str]:
    """Name of the message, and its style: the first row that applies."""
    return next((name, style) for applies, name, style in _STEPS if applies(state, state.snapshot))


def _down(state: SessionState) -> bool:
    ended = (one.name for one in state.processes if not one.alive and one.exit_code is not None)
    return any(name not in RECORDERS for name in ended)


_NOT_RESTARTED = {"audit", "guardian", "planner", "control", "link"}  # without any of them no action begins again


def process_ended(state: SessionState) -> bool:
    """Whether a process has ended for good that the session can't go on without."""
    return any(one.name in _NOT_RESTARTED for one in state.ended_processes)


def _gone(state: SessionState, name: str) -> bool:
    return any(process.name == name and not process.alive for process in state.processes)


def _may_command(state: SessionState, now: ControlSnapshot | None) -> bool:
    """Whether the shown gesture's push would begin something now: no push is asked for that is refused."""
    if now is None or state.report is None or state.report.gesture is None:
        return False
    action = ACTION_OF[state.report.gesture]
    return action in now.allowed and action not in now.by_key_only


def legs_of(now: ControlSnapshot) -> str:
    """What legs do that a stop ended: off, damped or held. Damped ones stay so when the stop was acknowledged.

    Joints that have power and no command yet bear as little as damped ones. A drive that does not answer may be stiff
    or limp, whatever it was ordered: where one is, damped and off are unconfirmed; where all are, held is.
    """
    silent = any(one.event is Event.JOINT_TIMEOUT and one.present for one in now.events)
    if not may_switch_off(now) and now.state is not GaitState.UNPOWERED:
        return "unconfirmed" if silent and all(one.age_ms > SILENT_MS for one in now.joints) else "held"
    if silent:
        return "unconfirmed"
    return "damped" if now.enabled else "off"


def may_switch_off(now: ControlSnapshot) -> bool:
    """Whether control carries out torque off: never while the legs are stiff, nor before a damping."""
    return now.effect is Effect.DAMP or now.damped


def slack(now: ControlSnapshot | None) -> bool:
    """Whether damped legs wait for a movement that grips them: their stop may be acknowledged already."""
    return now is not None and now.enabled and now.damped


def _holds(now: ControlSnapshot | None, legs: str) -> bool:
    return now is not None and now.effect is Effect.HOLD and legs_of(now) == legs


def in_mid_movement(now: ControlSnapshot | None) -> bool:
    """Whether a movement was cut short: only then gesture 0 follows the acknowledgement."""
    return now is not None and now.state is GaitState.BETWEEN


_GESTURES_ONLY = {Event.CAMERA_STALE, Event.PERCEPTION_TIMEOUT, Event.PERCEPTION_STARTING, Event.LINK_POOR}


def _gestures_refused(now: ControlSnapshot | None) -> bool:
    """Whether gestures are refused by more than not being armed. An event stays a second to be read, so this does."""
    return now is not None and any(one.event in _GESTURES_ONLY for one in now.events)


def _uncleared(now: ControlSnapshot) -> bool:
    """Whether whatever could begin now is refused for want of a pre-flight."""
    return bool(now.allowed) and set(now.allowed) <= set(now.uncleared)


_NEEDS_GESTURE_0 = (GaitState.UNPOWERED, GaitState.BETWEEN)
_FAULTS_OF_DRIVES = {Event.DRIVE_FAULT, Event.DRIVE_UNTRUSTED}


def needs_torque_off(state: SessionState) -> bool:
    """Whether something stays until the joints are switched off: a drive's fault, or silence without power or bus."""
    powered = state.snapshot is not None and state.snapshot.enabled
    present = {event.event for event in state.events if event.present}
    # an adapter that was plugged in again is found by opening its bus anew
    silent = Event.JOINT_TIMEOUT in present and (not powered or Event.BUS_FAULT in present)
    return silent or not present.isdisjoint(_FAULTS_OF_DRIVES)


def _ending(state: SessionState) -> bool:
    """Control's last word was that it ends: its silence after that is no fault."""
    return any(event.event in ENDINGS for event in state.events)


def _known_off(state: SessionState, now: ControlSnapshot | None) -> bool:
    """Control has ended here, or on the other computer in order, and it or the guardian switched the drives off."""
    ended = state.control_ended and (_gone(state, "control") or _ending(state))
    return ended and not state.left_on and now is not None and legs_of(now) != "unconfirmed"


_Applies = Callable[[SessionState, ControlSnapshot | None], bool]
_STEPS: tuple[tuple[_Applies, str, str], ...] = (
    (lambda state, _: bool(state.fault), "failed", "bold $error"),
    (lambda state, now: now is None and _down(state), "process_down", "bold $error"),
    (lambda _, now: now is None, "starting", "$text-muted"),
    (lambda state, _: state.unanswered and (state.left_on or not state.snapshot_fresh), "drives_silent", "bold $error"),
    (_known_off, "ended", "bold $warning"),
    (lambda state, _: state.abandoned and _gone(state, "control"), "nobody_stops", "bold $error"),
    (lambda state, _: _ending(state) and not _gone(state, "audit"), "ending", "bold $warning"),
    (lambda state, _: not state.snapshot_fresh and _gone(state, "guardian"), "nobody_stops", "bold $error"),
    (lambda state, _: not state.snapshot_fresh and _gone(state, "control"), "control_ended", "bold $error"),
    (lambda state, _: not state.snapshot_fresh, "control_silent", "bold $error"),
    (
        lambda state, now: (
            now is not None and now.effect is Effect.DAMP and legs_of(now) == "off" and not needs_torque_off(state)
        ),
        "off",
        "bold $error",
    ),
    (
        lambda _, now: now is not None and now.effect is Effect.DAMP and legs_of(now) == "unconfirmed",
        "unconfirmed",
        "bold $error",
    ),
    (lambda _, now: now is not None and now.effect is Effect.DAMP, "damped", "bold $error"),
    (
        lambda state, now: now is not None and now.action is None and process_ended(state),
        "process_ended",
        "bold $error",
    ),
    (
        lambda state, now: now is not None and now.effect is Effect.HOLD and needs_torque_off(state),
        "drive_held",
        "bold $error",
    ),
    (lambda _, now: _holds(now, "unconfirmed"), "drive_held", "bold $error"),
    (lambda _, now: _holds(now, "off"), "off", "bold $error"),
    (lambda _, now: _holds(now, "damped"), "damped", "bold $error"),
    (lambda _, now: _holds(now, "held") and not in_mid_movement(now), "held_at_rest", "bold $error"),
    (lambda _, now: _holds(now, "held"), "held", "bold $error"),
    (
        lambda _, now: now is not None and now.effect is Effect.PAUSE and now.action is not None,
        "paused",
        "bold $accent",
    ),
    (lambda _, now: now is not None and now.action is not None, "moving", "bold $accent"),
    (lambda _, now: slack(now), "slack", "bold $error"),
    (lambda _, now: now is not None and not now.patient_confirmed, "confirm", "bold $accent"),
    (lambda state, _: not ready(state), "checks", "bold $warning"),
    (lambda _, now: now is not None and _uncleared(now), "preflight", "bold $warning"),
    (lambda _, now: _gestures_refused(now), "keys_only", "bold $warning"),
    (lambda _, now: now is not None and not now.armed, "arm", "bold $accent"),
    (lambda _, now: now is not None and in_mid_movement(now) and now.enabled, "return", "bold $accent"),
    (lambda _, now: now is not None and now.state in _NEEDS_GESTURE_0, "initialise", "bold $accent"),
    (lambda state, _: state.report is not None and state.report.pressed, "withdraw", "bold $success"),
    (_may_command, "push", "bold $primary"),
    (lambda *_: True, "sign", "$primary"),
)
