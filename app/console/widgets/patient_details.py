"""A patient before a session: palm, gait, what changed and what was noted last time."""

from __future__ import annotations

from datetime import datetime

from textual.content import Content

from app.console.session_index import SessionRecord
from app.console.widgets.panel import Line, content_of, plain
from app.console.widgets.patient_trend import ago, session_lines, trend_lines
from app.system.vocabulary import VALID_FOR, VocabularyStatus
from app.text.catalogue import knows, tr
from kgdfa.gesture import Gesture
from profiles.palm import reference_segment
from profiles.schema import Profile
from profiles.store import Change

DAYS_A_MONTH = 30.4


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
    known = reference_segment(profile)
    return [
        plain(""),
        plain(tr("details.palm", reference_m=known.length_m, source=known.source, error=known.distance_error)),
        *(plain(tr("details.calibrated", when=ago(one.calibrated_at, now))) for one in profile.calibrations[-1:]),
        plain(tr("details.step", length_m=gait.step_length_m, time_s=gait.step_time_s)),
        plain(tr("details.stair", rise_m=gait.stair_rise_m)),
        plain(tr("details.dose", count=dose.steps, distance_m=dose.distance_m, minutes=dose.duration_s / 60)),
    ]


def _last(last: SessionRecord | None) -> list[Line]:
    if last is None:
        return [plain(""), plain(tr("details.never"), "$text-muted")]
    found = [
        plain(""),
        plain(tr("details.last", at=last.at[:16].replace("T", " ")), "bold"),
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
    fields = {field: new for change in since for field, (_, new) in change.changes.items()}
    if last is None or not fields:
        return []
    head = plain(tr("details.changed"), "bold $warning")
    return [head, *(plain(f"  {field_name(field)} → {new}") for field, new in list(fields.items())[:8])]


_FILE_UNITS = {"_cm": ("_m", "cm"), "_deg": ("_rad", "°")}  # of a name in the file: the form's, and what is shown


def field_name(path: str) -> str:
    """A field of a profile's file in the form's words, with its unit; one that the form lacks as it is."""
    key, unit = f"field.{path}", ""
    for suffix, (inside, shown) in _FILE_UNITS.items():
        if path.endswith(suffix):
            key, unit = f"field.{path.removesuffix(suffix)}{inside}", f" ({shown})"
    return tr(key) + unit if knows(key) else path


def vocabulary_text(profile: Profile, status: VocabularyStatus) -> str:
    """With which gestures the patient commands, and whether that is proven; empty where nothing is special."""
    if status is VocabularyStatus.NOT_NEEDED:
        return ""
    gestures = " ".join(tr(Gesture(one.value)) for one in profile.vocabulary)
    proven_on = profile.evidence.proven_at.date().isoformat() if profile.evidence else ""
    months = round(VALID_FOR.days / DAYS_A_MONTH)
    return f"{tr('start.vocabulary', gestures=gestures)}\n{tr(status, at=proven_on, months=months)}"


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
