"""The report as one HTML page: nothing is fetched, nothing runs, every text is made harmless and escaped."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from logs.findings import summary
from logs.manifest import COMMENTS
from logs.read import Outline, outline, outline_of, records, session_paths
from logs.records import Comment, Record
from logs.report import charts
from logs.report.facts import Diagnostics, facts_of
from logs.sanitize import sanitize_terminal
from logs.verify import Evidence, Finding, verify

FEW_EVENTS = 12  # beyond, they are summed up, too
MOST_EVENTS = 100  # that anybody reads one by one
MOST_EARLIER = 11  # sessions to compare with


def report(path: Path, evidence: Evidence) -> str:
    """The page of a session. Raises AuditError when the file can't be read or holds no records."""
    (finding,) = verify([path], evidence)
    found = records(path)
    this = outline_of(path, found)
    facts = facts_of(this, found)
    return render(facts, finding, _comments(path), _earlier(path, this))


def render(facts: Diagnostics, finding: Finding, comments: list[Record], earlier: list[Outline]) -> str:
    """The page from its facts."""
    return (
        _environment()
        .get_template("page.html.j2")
        .render(
            name=finding.file.stem,
            facts=facts,
            finding=finding,
            proof_word=finding.status.value.capitalize() + ".",
            proof=summary(finding),
            numbers=_numbers(facts),
            shades=charts.SHADES,
            few=FEW_EVENTS,
            most=MOST_EVENTS,
            comments=comments,
            charts={
                "timeline": charts.timeline(facts),
                "joints": [charts.joint(trace, facts.duration_s) for trace in facts.joints],
                "spreads": charts.spreads(facts.latencies),
                "earlier": charts.earlier([*earlier, facts.outline]) if earlier else Markup(""),
            },
        )
    )


def _numbers(facts: Diagnostics) -> tuple[tuple[str, str], ...]:
    this = facts.outline
    return (
        (str(this.steps), "steps"),
        (f"{this.distance_m:.1f} m", "walked"),
        (f"{this.completed}/{this.actions}", "actions completed"),
        (str(this.refusals), "refusals"),
        (str(this.events), "events"),
        (str(this.stops), "STOPs"),
    )


def _comments(path: Path) -> list[Record]:
    beside = path.with_name(path.stem + COMMENTS)
    found = records(beside) if beside.exists() else []
    return [record for record in found if isinstance(record.body, Comment)]


def _earlier(path: Path, this: Outline) -> list[Outline]:
    """This patient's sessions before this one, oldest first."""
    before = [other for other in session_paths(path.parent) if other.name < path.name]
    outlines = (outline(other) for other in reversed(before[-3 * MOST_EARLIER :]))
    same = [each for each in outlines if each.patient == this.patient and this.patient]
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
