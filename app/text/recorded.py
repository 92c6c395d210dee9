"""Records of the trail as text: values of enumerations (an action, a state) get their name in the language in use."""

from __future__ import annotations

from enum import Enum

from msgspec import structs

from app.ipc.states import Action, Effect, GaitState, Outcome, PauseCause, Source
from app.text.catalogue import key_of, knows, tr
from kgdfa.gesture import Gesture
from logs.reason import Reason
from logs.records import GuidedTestResult

# Field of a record → the enumeration whose member's value, or name in lower case, it holds.
_ENUMERATIONS: dict[str, type[Enum]] = {
    "action": Action,
    "cause": PauseCause,
    "effect": Effect,
    "from_effect": Effect,
    "to_effect": Effect,
    "gesture": Gesture,
    "outcome": Outcome,
    "running": Action,
    "source": Source,
    "from_state": GaitState,
    "state": GaitState,
    "to_state": GaitState,
}
# Fields of enumerations that are not loaded here, and the classes in their members' keys.
_CLASSES = {
    "by": ("StopSource",),
    "change": ("OperatorChange",),
    "contact": ("Contact",),
    "intrinsics_source": ("IntrinsicsSource",),
    "joint": ("Joint",),
    "method": ("ReferenceSource",),
    "phase": ("Phase",),
    "proof": ("Proof",),
    "role": ("Role", "InputRole"),
    "state": ("DriveState",),
    "subject": ("Subject",),
    "test": ("GuidedTest",),
}


def render_recorded(what: Reason) -> str:
    """The text of a recorded reason, or of a record of `logs.show`. Raises when values do not fit the wording."""
    return tr(what.code, **{name: _named(name, value) for name, value in what.values.items()})


def result_text(result: GuidedTestResult) -> str:
    """A guided test's result on one line, in a live session too: `logs.show` takes a third of a second to load."""
    speed = "–" if result.speed_m_s is None else result.speed_m_s
    values = {**structs.asdict(result), "reason": result.reason or "", "speed_m_s": speed}
    return render_recorded(Reason("Record.GuidedTestResult", values))


def _named(field: str, value: object) -> object:
    if field in _ENUMERATIONS:
        members = _ENUMERATIONS[field]
        named = next((each for each in members if value in (each.value, each.name.lower())), None)
        if named is not None:
            return named if knows(key_of(named)) else value
    if field not in _CLASSES:
        return value
    member = str(value).upper().replace(" ", "_").replace("-", "_")
    keys = [*(f"{kind}.{member}" for kind in _CLASSES[field]), f"recorded.{value}"]  # a demonstration: no role
    return next((Reason(key) for key in keys if knows(key)), value)
