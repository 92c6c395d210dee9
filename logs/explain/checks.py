"""The values that a record's decision compared, each with its limit."""

from __future__ import annotations

from dataclasses import dataclass

from logs import records as r
from logs.reason import Reason
from logs.records import Body

# Value → its limit; None: a value that has none.
_LIMITS: dict[type, dict[str, str | None]] = {
    r.GestureOnset: {"confidence": None, "votes": None},
    r.Press: {"safe_distance_m": "threshold_m"},
    r.Hint: {"safe_distance_m": "threshold_m"},
    r.Cancel: {"safe_distance_m": "release_m", "held_ns": "held_limit_ns"},
    r.Release: {"safe_distance_m": "release_m", "held_ns": "held_limit_ns"},
    r.EventRaised: {"value": "limit"},
    r.Refusal: {"value": "limit"},
    r.GuardRefusal: {"value": "limit"},
    r.PlanChecked: {"duration_s": None, "min_clearance_m": None},
}
_LEAST = {  # limits that the value must reach; others it may not exceed
    (r.Press, "approached_m"),
    (r.Hint, "approached_m"),
    (r.Cancel, "safe_distance_m"),
    (r.Cancel, "held_ns"),
    (r.Release, "safe_distance_m"),
    (r.Release, "held_ns"),
}
_TOO_LONG = "PressCancel.TOO_LONG"
# Quantities with a limit on either side: of a value below its limit the limit was the lower one.
_TWO_SIDED = {"angle_rad", "position", "stiffness", "damping", "request_age_ms"}
_APPROACH = {"approached_m": "approach_limit_m"}  # a press alone asks for it
_BUTTON = {
    "distance_m": None,
    "previous_m": None,
    "nearer_m": "nearer_limit_m",
    "beside_px": "beside_limit_px",
    "elapsed_ns": "elapsed_limit_ns",
    "gap_frames": "gap_limit_frames",
    "anchor_m": None,
    "focal_px": None,
}
_OF_BUTTON = (r.Press, r.Hint, r.Cancel, r.Release)
_LATER = {"held_limit_ns", "elapsed_limit_ns", "gap_limit_frames"}  # 0 in a trail from before: not recorded then
_SOURCES = {"anchor_m": ("anchor_method", "ReferenceSource"), "focal_px": ("focal_source", "IntrinsicsSource")}
_NO_SOURCE = ("", "")


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """A value that decided, with its limit; None: not recorded, or without one."""

    name: str
    value: float | None
    limit: float | None = None
    least: bool = False  # the value must reach the limit
    source: str = ""  # where it is from: measured, assumed
    source_class: str = ""  # in the catalogues
    recorded: bool = True  # False: by a version that did not record it

    @property
    def margin(self) -> float | None:
        """How far the value is within its limit; negative beyond it."""
        if self.value is None or self.limit is None:
            return None
        return self.value - self.limit if self.least else self.limit - self.value


def checks_of(body: Body) -> tuple[Check, ...]:
    """All of one record, in the order of the tables."""
    kind = type(body)
    pairs = _LIMITS.get(kind, {}) | (_BUTTON if kind in _OF_BUTTON else {})
    pairs |= _APPROACH if kind in (r.Press, r.Hint) else {}
    quantity = getattr(body, "quantity", "")
    recorded = kind not in _OF_BUTTON or bool(getattr(body, "captured_ns", 0))
    return tuple(
        Check(
            name=quantity or name if name == "value" else name,
            value=getattr(body, name),
            limit=(getattr(body, limit) or None) if limit in _LATER else getattr(body, limit) if limit else None,
            least=_is_least(body, name) or (name == "value" and _is_below(quantity, body)),
            source=getattr(body, _SOURCES.get(name, _NO_SOURCE)[0], ""),
            source_class=_SOURCES.get(name, _NO_SOURCE)[1],
            recorded=recorded,
        )
        for name, limit in pairs.items()
        if name != "value" or quantity
    )


def _is_least(body: Body, name: str) -> bool:
    """Whether the value must reach its limit; of a press that was too long the limit is the longest."""
    too_long = isinstance(body, r.Cancel) and isinstance(body.reason, Reason) and body.reason.code == _TOO_LONG
    return (type(body), name) in _LEAST and not (too_long and name == "held_ns")


def _is_below(quantity: str, body: Body) -> bool:
    """Whether the compared value lies below the lower one of a quantity's two limits."""
    value, limit = getattr(body, "value", None), getattr(body, "limit", None)
    return quantity in _TWO_SIDED and value is not None and limit is not None and value < limit
