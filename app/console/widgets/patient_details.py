"""A patient before a session: palm, gait, what changed, what sessions came to; and who has waited longest. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import UTC, datetime
from enum import Enum
from typing import Any

from textual.content import Content

from app.console.patient_fields import FIELDS
from app.console.session_index import SessionRecord
from app.console.widgets.panel import Line, content_of, plain
from app.system.vocabulary import VALID_FOR, VocabularyStatus
from app.text.catalogue import knows, tr
from kgdfa.gesture import Gesture
from profiles.fields import file_key
from profiles.palm import calibrated_camera, calibration_for, reference_segment
from profiles.schema import Profile
from profiles.store import Change

DAYS_A_MONTH = 30.4
BARS = "▁▂▃▄▅▆▇█"
NO_BAR = "·"  # not asked
IN_LIST = 8  # sessions in a row of the list
IN_DETAILS = 20
LISTED = 4  # sessions with a line of their own
# Row → its figure of a session, and the greatest there is; None: the greatest of this patient's sessions.
ROWS: dict[str, tuple[Callable[[SessionRecord], float | None], float | None]] = {
    "steps": (lambda one: one.steps, None),
    "distance": (lambda one: one.distance_m, None),
    "refusals": (lambda one: one.refusals, None),
    "discomfort": (lambda one: one.discomfort, 10.0),
    "pain": (lambda one: one.pain, 10.0),
    "exertion": (lambda one: one.exertion, 20.0),
}


def describe(
    profile: Profile, changes: tuple[Change, ...], sessions: tuple[SessionRecord, ...], now: datetime
) -> Content:
    """Some thirty short lines, the most asked for first."""
    lines: list[Line] = [plain(profile.identifier, "bold $primary")]
    if profile.note:
        lines.append(plain(profile.note))
    last = sessions[-1] if sessions else None
    lines += _last(last)
    lines += session_lines(sessions)
    lines += trend_lines(sessions)
    lines += _changed(changes, last)
    lines += _figures(profile, now)
    return content_of(tuple(lines))


def _figures(profile: Profile, now: datetime) -> list[Line]:
    gait, dose = profile.gait, profile.dose
    camera = calibrated_camera(profile)
    known, newest = reference_segment(profile, camera=camera), calibration_for(profile, camera)
    return [
        plain(""),
        plain(tr("details.palm", reference_m=known.length_m, source=known.source, error=known.distance_error)),
        *([plain(tr("details.calibrated", when=ago(newest.calibrated_at, now), camera=camera))] if newest else []),
        plain(tr("details.step", length_m=gait.step_length_m, time_s=gait.step_time_s)),
        plain(tr("details.stair", rise_m=gait.stair_rise_m)),
        plain(tr("details.dose", count=dose.steps, distance_m=dose.distance_m, minutes=dose.duration_s / 60)),
    ]


def _last(last: SessionRecord | None) -> list[Line]:
    if last is None:
        return [plain(""), plain(tr("details.never"), "$text-muted")]
    found = [
        plain(""),
        plain(tr("details.last", at=local_text(last.at)), "bold"),
        plain(tr("details.did", count=last.steps, distance_m=last.distance_m, minutes=last.duration_s / 60)),
    ]
    for name in ("discomfort", "pain", "exertion"):
        rating = getattr(last, name)
        if rating is not None:
            found.append(plain(tr(f"details.{name}", rating=rating)))
    if last.note:
        found.append(plain(f"“{last.note}”"))
    return found


def _changed(changes: tuple[Change, ...], last: SessionRecord | None) -> list[Line]:
    since = [change for change in changes if last is None or change.at > last.at]
    fields = changed_values({field: values for change in since for field, values in change.changes.items()})
    if last is None or not fields:
        return []
    head = plain(tr("details.changed"), "bold $warning")
    shown = (f"  {field_name(field)}" + (f" → {values[1]}" if values else "") for field, values in fields.items())
    return [head, *map(plain, list(shown)[:8])]


_ONLY_NAMED = ("calibrations", "evidence")  # lists and tables: a line has no room for what they hold
_CHOICES = {field.path: field.choices for field in FIELDS if field.choices} | {"vocabulary": Gesture}


def changed_values(changes: Mapping[str, tuple[Any, Any]]) -> dict[str, tuple[str, str] | None]:
    """By field what it was and what it is, in the language in use; None: that it changed is all that is shown."""
    found: dict[str, tuple[str, str] | None] = {}
    for field, (old, new) in changes.items():
        if field == "schema":  # the file's own: nothing of the patient
            continue
        group = field.partition(".")[0]
        if group in _ONLY_NAMED:
            found[group] = None
        else:
            found[field] = (_value_text(field, old), _value_text(field, new))
    return found


def _value_text(field: str, value: object) -> str:
    """As the form shows it; what no choice of this version has stands as in the file."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return tr("dialog.yes" if value else "dialog.no")
    named = {one.value: tr(one) for one in _CHOICES.get(field, ())}
    return " ".join(named.get(part, part) for part in str(value).split(" "))


_BY_FILE_NAME = {file_key(field.path)[0]: field for field in FIELDS}


def field_name(path: str) -> str:
    """A field of a profile's file in the form's words, with the form's unit; one that the form lacks as it is."""
    field = _BY_FILE_NAME.get(path)
    key = f"field.{field.path if field else path}"
    unit = f" ({field.unit})" if field and field.unit else ""
    return tr(key) + unit if knows(key) else path


def vocabulary_text(profile: Profile, status: VocabularyStatus, key_names: Mapping[str, str]) -> str:
    """With which gestures the patient commands, and whether that is proven; empty where nothing is special."""
    if status is VocabularyStatus.NOT_NEEDED:
        return ""
    gestures = " ".join(tr(Gesture(one.value)) for one in profile.vocabulary)
    proven_on = local_text(profile.evidence.proven_at.isoformat())[:10] if profile.evidence else ""
    months = round(VALID_FOR.days / DAYS_A_MONTH)
    return f"{tr('start.vocabulary', gestures=gestures)}\n{tr(status, at=proven_on, months=months, **key_names)}"


def identity(profile: Profile) -> str:
    """What a therapist compares with the patient."""
    return tr(
        "confirm.text",
        identifier=profile.identifier,
        sex=profile.sex,
        stature_m=profile.stature_m,
        mass_kg=profile.mass_kg,
        note=profile.note,
    )


class PatientOrder(Enum):
    """How the list is sorted."""

    IDENTIFIER = "identifier"
    WAITING = "waiting"  # longest without a session first
    RECENT = "recent"  # the last session first


def sparkline(values: Iterable[float | None], most: float | None = None) -> str:
    """A bar for each value from 0 to `most` (None: the greatest of them); a dot where there is none."""
    found = list(values)
    top = most or max((value for value in found if value is not None), default=0.0) or 1.0
    return "".join(NO_BAR if value is None else bar_of(value / top) for value in found)


def trend_lines(sessions: Sequence[SessionRecord]) -> list[Line]:
    """A bar a session, oldest first, with the newest figure; rows that were never asked are left out."""
    recent = sessions[-IN_DETAILS:]
    lines: list[Line] = []
    for name, (value_of, most) in ROWS.items():
        values = [value_of(one) for one in recent]
        if any(values) or (most is not None and any(value is not None for value in values)):
            newest = NO_BAR if values[-1] is None else f"{values[-1]:.0f}"
            bars = (sparkline(values, most), "$primary")
            lines.append(((f"{tr(f'trend.{name}')}  ", "$text-muted"), bars, (f"  {newest}", "bold")))
    return [plain(""), plain(tr("trend.title", count=len(recent)), "bold"), *lines] if len(recent) > 1 else []


def session_lines(sessions: Sequence[SessionRecord]) -> list[Line]:
    """The sessions before the last one, newest first, a line each."""
    return [
        (
            (f"{local_text(one.at)[:10]}  ", "$text-muted"),
            (tr("details.did", count=one.steps, distance_m=one.distance_m, minutes=one.duration_s / 60), ""),
            (f"  “{one.note}”" if one.note else "", "italic"),
        )
        for one in reversed(sessions[-1 - LISTED : -1])
    ]


def local_time(at: str) -> datetime:
    """In this computer's time zone; at: ISO 8601, without a zone UTC. Raises ValueError."""
    moment = datetime.fromisoformat(at)
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).astimezone()


def local_text(at: str) -> str:
    """Day and minute in this computer's time zone; what is no time as it stands."""
    try:
        return f"{local_time(at):%Y-%m-%d %H:%M}"
    except (ValueError, OverflowError):
        return at[:16]


def days_since(at: str, now: datetime) -> int:
    """Whole days of the calendar in this computer's time zone since then; the future is today."""
    return max(0, (now.astimezone().date() - local_time(at).date()).days)


def ago(at: str, now: datetime) -> str:
    """How long ago, in days; what is no time as it stands."""
    try:
        days = days_since(at, now)
    except (ValueError, OverflowError):
        return local_text(at)
    return tr("patients.days_ago", count=days) if days else tr("patients.today")


def last_cells(sessions: Sequence[SessionRecord], now: datetime) -> tuple[str, str]:
    """For the list: when the last session was, and the steps of the newest ones."""
    if not sessions:
        return NO_BAR, ""
    return ago(sessions[-1].at, now), sparkline(one.steps for one in sessions[-IN_LIST:])


def in_order(order: PatientOrder, last_at: dict[str, str]) -> list[str]:
    """Identifiers, sorted. last_at: the last session of each; empty: none yet, who waits longest."""
    names = sorted(last_at)
    if order is PatientOrder.IDENTIFIER:
        return names
    return sorted(names, key=lambda name: last_at[name], reverse=order is PatientOrder.RECENT)


def bar_of(share: float) -> str:
    """The bar of this share; what is outside 0 to 1 as its nearest end."""
    return BARS[min(len(BARS) - 1, max(0, int(share * len(BARS))))]
