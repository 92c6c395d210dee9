"""What is to know of a patient before a session: palm, gait, what changed and what was noted last time."""

from __future__ import annotations

from textual.content import Content

from app.console.session_index import SessionRecord
from app.console.widgets.panel import Line, plain
from app.text.catalogue import tr
from profiles.palm import reference_segment
from profiles.schema import Profile
from profiles.store import Change


def describe(profile: Profile, changes: tuple[Change, ...], sessions: tuple[SessionRecord, ...]) -> Content:
    """Some twenty short lines."""
    lines: list[Line] = [plain(profile.identifier, "bold $primary")]
    if profile.note:
        lines.append(plain(profile.note))
    lines += _figures(profile)
    last = sessions[-1] if sessions else None
    lines += _last(last)
    lines += _changed(changes, last)
    return Content("\n").join(Content.assemble(*line) for line in lines)


def _figures(profile: Profile) -> list[Line]:
    gait, dose = profile.gait, profile.dose
    known = reference_segment(profile)
    return [
        plain(""),
        plain(
            tr(
                "details.palm",
                cm=f"{known.length_m * 100:.1f}",
                source=tr(f"details.{known.source.value}"),
                error=f"{known.distance_error * 100:.0f}",
            )
        ),
        plain(tr("details.step", cm=f"{gait.step_length_m * 100:.0f}", time=f"{gait.step_time_s:.1f}")),
        plain(tr("details.stair", cm=f"{gait.stair_rise_m * 100:.0f}")),
        plain(
            tr("details.dose", steps=dose.steps, metres=f"{dose.distance_m:.0f}", minutes=f"{dose.duration_s / 60:.0f}")
        ),
    ]


def _last(last: SessionRecord | None) -> list[Line]:
    if last is None:
        return [plain(""), plain(tr("details.never"), "$text-muted")]
    found = [
        plain(""),
        plain(tr("details.last", at=last.at[:16].replace("T", " ")), "bold"),
        plain(
            tr("details.did", steps=last.steps, metres=f"{last.distance_m:.1f}", minutes=f"{last.duration_s / 60:.0f}")
        ),
    ]
    if last.discomfort is not None:
        found.append(plain(tr("details.discomfort", rating=last.discomfort)))
    if last.note:
        found.append(plain(f"“{last.note}”"))
    return found


def _changed(changes: tuple[Change, ...], last: SessionRecord | None) -> list[Line]:
    since = [change for change in changes if last is None or change.at > last.at]
    fields = {field: new for change in since for field, (_, new) in change.changes.items()}
    if last is None or not fields:
        return []
    head = plain(tr("details.changed"), "bold $warning")
    return [head, *(plain(f"  {field} → {new}") for field, new in list(fields.items())[:8])]


def identity(profile: Profile) -> str:
    """Who the legs will move for: what a therapist compares with the patient."""
    return tr(
        "confirm.words",
        identifier=profile.identifier,
        sex=tr(f"sex.{profile.sex.value}"),
        stature=f"{profile.stature_m * 100:.0f}",
        mass=f"{profile.mass_kg:.0f}",
        note=profile.note,
    )
