"""What a patient's sessions came to, small: when the last one was, a bar for each, and who has waited longest. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime
from enum import Enum

from app.console.session_index import SessionRecord
from app.console.widgets.panel import Line, plain
from app.text.catalogue import tr

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
            (f"{one.at[:10]}  ", "$text-muted"),
            (tr("details.did", count=one.steps, distance_m=one.distance_m, minutes=one.duration_s / 60), ""),
            (f"  “{one.note}”" if one.note else "", "italic"),
        )
        for one in reversed(sessions[-1 - LISTED : -1])
    ]


def days_since(at: str, now: datetime) -> int:
    """Whole days of the calendar (UTC) since then; the future is today."""
    moment = datetime.fromisoformat(at)
    return max(0, (now.date() - (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).astimezone(UTC).date()).days)


def ago(at: str, now: datetime) -> str:
    """How long ago, in days."""
    days = days_since(at, now)
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
