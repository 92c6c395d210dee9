"""The checks before a session is armed: each turns green by itself, or says what mends it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from app.console.state import SessionState
from app.ipc.states import Effect

_JOINT_STALE_MS = 100.0
_PATIENCE_S = 8.0  # starting the processes and loading the hand model


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


@dataclass(frozen=True, slots=True)
class Result:
    """One line of the list."""

    name: str
    light: Light


def _processes(state: SessionState) -> bool:
    return len(state.processes) >= 5 and all(process.alive for process in state.processes)


def _audit(state: SessionState) -> bool:
    return state.audit is not None and not state.audit.fault


def _joints(state: SessionState) -> bool:
    return state.snapshot is not None and all(
        joint.age_ms < _JOINT_STALE_MS and not joint.fault for joint in state.snapshot.joints
    )


def _camera(state: SessionState) -> bool:
    return state.report_fresh and state.report is not None and not state.report.camera_fault


def _clear(state: SessionState) -> bool:
    return state.snapshot is not None and state.snapshot.effect < Effect.HOLD


def _real_time(state: SessionState) -> bool:
    return state.snapshot is not None and state.snapshot.real_time.fifo


def _press_zone(state: SessionState) -> bool:
    zone = None if state.report is None else state.report.press_zone
    return zone is None or zone.fits


def _confirmed(state: SessionState) -> bool:
    return state.snapshot is not None and state.snapshot.patient_confirmed


CHECKS = (
    Check("processes", _processes),
    Check("audit", _audit),
    Check("control", lambda state: state.snapshot_fresh),
    Check("joints", _joints),
    Check("camera", _camera),
    Check("clear", _clear),
    Check("press_zone", _press_zone, must=False),
    Check("real_time", _real_time, must=False),
    Check("patient", _confirmed, operator=True),
)


def results(state: SessionState) -> tuple[Result, ...]:
    """Every check as it stands now."""
    return tuple(Result(check.name, _light(check, state)) for check in CHECKS)


def ready(state: SessionState) -> bool:
    """Whether everything that must be green is."""
    return all(check.passes(state) for check in CHECKS if check.must)


def _light(check: Check, state: SessionState) -> Light:
    if check.passes(state):
        return Light.GREEN
    if not check.must and state.snapshot is not None:
        return Light.AMBER
    if check.operator or (state.elapsed_s < _PATIENCE_S and not state.fault):
        return Light.WAITING
    return Light.RED
