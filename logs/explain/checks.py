"""The values that a record's decision compared, each with its limit."""

from __future__ import annotations

from dataclasses import dataclass

from logs import records as r
from logs.records import Body

# Value → its limit; None: a value that has none. The margin is limit minus value.
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
_BUTTON = {
    "distance_m": None,
    "previous_m": None,
    "nearer_m": "nearer_limit_m",
    "approached_m": "approach_limit_m",
    "beside_px": "beside_limit_px",
    "elapsed_ns": "elapsed_limit_ns",
    "gap_frames": "gap_limit_frames",
    "anchor_m": None,
    "focal_px": None,
}
_OF_BUTTON = (r.Press, r.Hint, r.Cancel, r.Release)
_LATER = {"held_limit_ns", "elapsed_limit_ns", "gap_limit_frames"}  # 0 in a trail from before: not recorded then
_SOURCES = {"anchor_m": "anchor_method", "focal_px": "focal_source"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """A value that decided, with its limit; None: not recorded, or without one."""

    name: str
    value: float | None
    limit: float | None = None
    source: str = ""  # where it is from: measured, assumed

    @property
    def margin(self) -> float | None:
        """How far the value is below its limit."""
        return None if self.value is None or self.limit is None else self.limit - self.value


def checks_of(body: Body) -> tuple[Check, ...]:
    """All of one record, in the order of the tables."""
    pairs = _LIMITS.get(type(body), {}) | (_BUTTON if isinstance(body, _OF_BUTTON) else {})
    quantity = getattr(body, "quantity", "")
    return tuple(
        Check(
            name=quantity or name if name == "value" else name,
            value=getattr(body, name),
            limit=(getattr(body, limit) or None) if limit in _LATER else getattr(body, limit) if limit else None,
            source=getattr(body, _SOURCES.get(name, ""), ""),
        )
        for name, limit in pairs.items()
        if name != "value" or quantity
    )
