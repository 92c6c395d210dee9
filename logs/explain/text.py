"""An explanation as text and as values for JSON."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from enum import Enum
from math import degrees
from typing import Any

import msgspec

from logs.explain.checks import Check
from logs.explain.hops import Explanation, Hop, Step
from logs.reason import Reason, Render, key_of, sanitize_terminal, text_of
from logs.show import kind_of, record_text


class Sent(Enum):
    """How a STOP was given, where not by a key."""

    VOICE = "voice"
    TAKEOVER = "takeover"


class HopNote(Enum):
    """What is added to the hops."""

    NOT_RECORDED = "not recorded"
    NOT_MEASURED = "not measured"
    AT_MOST = "at most"  # name, value, limit, margin: words of the next two
    AT_LEAST = "at least"
    WITHIN = "within"  # margin
    BEYOND = "beyond"  # margin
    MEASURED = "measured"  # name, value
    FROM_FIRST = "from first"  # from_first_ms, hop_ms


def lines(explanation: Explanation, render: Render) -> Iterator[str]:
    """As text, safe for a terminal."""
    about = explanation.about
    before_ns = next((step.at_ns for step in explanation.steps if step.at_ns), 0)
    first_ns = next((step.at_ns for step in explanation.steps if step.at_ns and step.hop is Hop.CAPTURED), before_ns)
    yield sanitize_terminal(f"#{about.sequence} {kind_of(about.body)}: {record_text(about.body, render)}")
    for step in explanation.steps:
        if step.at_ns is None:
            when = text_of(Reason(key_of(HopNote.NOT_RECORDED)), render)
        else:
            values: dict[str, Any] = {
                "from_first_ms": (step.at_ns - first_ns) / 1e6,
                "hop_ms": (step.at_ns - before_ns) / 1e6,
            }
            when = text_of(Reason(key_of(HopNote.FROM_FIRST), values), render)
            before_ns = step.at_ns
        mark = "►" if step.record is about else " "
        reference = f" [#{step.record.sequence}]" if step.record is not None else ""
        yield sanitize_terminal(f"{mark} {when}  {text_of(Reason(_key_of_hop(step)), render)}{reference}")
        if step.record not in (None, about) and (step.checks or step.hop is Hop.RAISED):
            yield sanitize_terminal(f"      {record_text(step.record.body, render)}")
        yield from (sanitize_terminal(f"      {_text(check, render)}") for check in step.checks)


def _key_of_hop(step: Step) -> str:
    """The wording of a hop; that of a STOP's beginning is by how it was given."""
    by = getattr(step.record.body, "by", "") if step.record is not None and step.hop is Hop.SENT else ""
    return next((key_of(sent) for sent in Sent if sent.value == by), key_of(step.hop))


# Quantities with a wording; the guard's are shown as they are recorded.
_WORDED = """
    confidence votes safe_distance_m held_ns elapsed_ns gap_frames distance_m previous_m nearer_m approached_m
    beside_px anchor_m focal_px duration_s min_clearance_m late_ms following_rad drift_rad_s temperature_c
    speed_rad_s torque_nm angle_rad pose_error_rad frame_age_ms message_age_ms reader_age_ms answer_age_ms
    waiting_records slept_s step_s rejected_messages foreign_peers stop_presses request_age_ms before_arming_ms
"""
NAMED = frozenset(_WORDED.split())


def _text(check: Check, render: Render) -> str:
    def worded(note: HopNote, **values: Any) -> str:
        return text_of(Reason(key_of(note), values), render)

    name = text_of(Reason(f"compared.{check.name}"), render) if check.name in NAMED else check.name
    if check.value is None:
        return worded(HopNote.MEASURED, name=name, value=worded(_absent(check)))
    value = _shown(check.name, check.value)
    if check.source:
        value += f" ({text_of(Reason(f'{check.source_class}.{check.source.upper()}'), render)})"
    if check.limit is None or check.margin is None:
        return worded(HopNote.MEASURED, name=name, value=value)
    note = HopNote.AT_LEAST if check.least else HopNote.AT_MOST
    margin = worded(
        HopNote.BEYOND if check.margin < 0 else HopNote.WITHIN, margin=_shown(check.name, abs(check.margin))
    )
    return worded(note, name=name, value=value, limit=_shown(check.name, check.limit), margin=margin)


def _absent(check: Check) -> HopNote:
    return HopNote.NOT_MEASURED if check.recorded else HopNote.NOT_RECORDED


# Suffix of a name → how its values are shown.
_UNITS = (  # longer suffixes come first
    ("_rad_s", 1.0, "rad/s"),
    ("_rad", degrees(1.0), "°"),
    ("_nm", 1.0, "Nm"),
    ("_ns", 1e-6, "ms"),
    ("_ms", 1.0, "ms"),
    ("_px", 1.0, "px"),
    ("_m", 100.0, "cm"),
    ("_c", 1.0, "°C"),
    ("_s", 1.0, "s"),
)


def _shown(name: str, value: float) -> str:
    factor, unit = next(((factor, unit) for end, factor, unit in _UNITS if name.endswith(end)), (1.0, ""))
    return f"{value * factor:.4g} {unit}".strip()


def to_values(explanation: Explanation) -> dict[str, Any]:
    """For JSON: numbers as recorded, in SI units and nanoseconds; null: not recorded then."""
    return {
        "sequence": explanation.about.sequence,
        "record": msgspec.to_builtins(explanation.about),
        "hops": list(_hops(explanation.steps)),
    }


def _hops(steps: Iterable[Step]) -> Iterator[dict[str, Any]]:
    before_ns: int | None = None
    for step in steps:
        known = step.at_ns is not None and before_ns is not None
        yield {
            "hop": step.hop.value,
            "at_ns": step.at_ns,
            "since_previous_ns": step.at_ns - before_ns if known else None,  # type: ignore[operator]
            "record": step.record.sequence if step.record is not None else None,
            "compared": [
                {"name": one.name, "value": one.value, "limit": one.limit, "least": one.least}
                | {"margin": one.margin, "source": one.source}
                for one in step.checks
            ],
        }
        before_ns = step.at_ns or before_ns
