"""The report as one HTML page: nothing is fetched, nothing runs, every text is made safe and escaped."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from logs.comments import comments_on
from logs.errors import AuditError, AuditFault
from logs.findings import summary
from logs.journal import parted
from logs.read import Outline, outline, outline_of, records, session_paths
from logs.reason import Reason, Render, reason, sanitize_terminal, text_of
from logs.report import charts
from logs.report.data import ReportData, data_of
from logs.show import UNKNOWN
from logs.verify import Evidence, verify

FEW_EVENTS = 12  # beyond, a table sums them up
MOST_EVENTS = 100  # listed one by one
MOST_EARLIER = 11  # sessions to compare with


def report(
    path: Path,
    evidence: Evidence,
    render: Render,
    language: str = "en",
    *,
    outcomes: Sequence[tuple[str, str, str]] = (),
    outcome_notes: Sequence[str] = (),
) -> str:
    """The page of a session, its text made by `render`. Raises AuditError for a file that can't be read or holds none.

    outcomes: name, value and smallest change that means something, of what the session's legs were measured to have
    done. outcome_notes: what a reader must know of them, and where each change is from.
    """
    (finding,) = verify([path], evidence)
    found = records(path)
    if not found:
        raise AuditError(AuditFault.TRAIL_EMPTY, path=path)
    this = outline_of(found)
    data = data_of(this, found, render)
    earlier = _earlier(path, this)
    comments = comments_on(path, evidence, {record.sequence: record.hash for record in found}.get)

    def t(key: str, **values: Any) -> str:
        return render(Reason(key, values))

    return (
        _environment()
        .get_template("page.html.j2")
        .render(
            name=finding.file.stem,
            data=data,
            finding=finding,
            t=t,
            language=language,
            status=render(reason(finding.status)),
            proof=summary(finding, render),
            remarks=[text_of(remark, render) for remark in finding.remarks],
            numbers=_numbers(data),
            shades=charts.SHADES,
            few=FEW_EVENTS,
            most=MOST_EVENTS,
            comments=comments.records,
            comments_hidden=[text_of(why, render) for why in comments.hidden],
            outcomes=outcomes,
            outcome_notes=outcome_notes,
            charts={
                "timeline": charts.timeline(data, t),
                "joints": [charts.joint(trace, data.outline.duration_s, t) for trace in data.joints],
                "spreads": charts.spreads(data.latencies, t),
                "earlier": charts.earlier([*earlier, data.outline], t) if earlier else Markup(""),
            },
        )
    )


def _numbers(data: ReportData) -> tuple[tuple[str, str], ...]:
    """(value, key of its label)."""
    this = data.outline
    found = (
        (this.steps, "{}", "report.steps"),
        (this.distance_m, "{:.1f} m", "report.walked"),
        (this.completed, f"{{}}/{this.actions}", "report.completed"),
        (this.refusals, "{}", "report.refusals"),
        (this.events, "{}", "report.events"),
        (this.stops, "{}", "report.stops"),
    )
    return tuple((UNKNOWN if value is None else form.format(value), label) for value, form, label in found)


def _earlier(path: Path, this: Outline) -> list[Outline]:
    """This patient's sessions before this one, oldest first, of those that can be read."""
    before = [other for other in session_paths(path.parent) if parted(other.stem) < parted(path.stem)]
    same: list[Outline] = []
    for other in reversed(before[-3 * MOST_EARLIER :]):
        with suppress(AuditError):
            each = outline(other)
            same += [each] if each.patient == this.patient and this.patient else []
    return list(reversed(same[:MOST_EARLIER]))


def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("logs.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        finalize=_finally,
    )
    environment.filters |= {"clock": charts.clock, "ms": _ms, "seconds": _seconds}
    return environment


def _finally(value: Any) -> Any:
    return sanitize_terminal(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def _ms(value: float | None) -> str:
    return "–" if value is None else f"{value:.0f} ms"


def _seconds(value: float | None) -> str:
    return "–" if value is None else f"{value:.1f} s"
