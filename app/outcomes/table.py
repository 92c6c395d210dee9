"""Outcomes over sessions: as text, one row a measure and one column a session, and as series, which a plot shows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rich.table import Table
from rich.text import Text

from app.outcomes.change import SMALLEST_CHANGES, SmallestChange
from app.outcomes.guided import GuidedTest, last_completed
from app.outcomes.measures import Measures
from app.outcomes.session import COMPLETED, Dose, OutcomeSource, SessionOutcomes
from app.text.catalogue import tr
from app.text.recorded import render_recorded, result_text
from hal.joints.device import Joint
from logs.reason import Reason, sanitize_terminal

NONE = "–"
# key of the wording, field, format; units stand in the wording
ROWS = (
    ("steps", "steps", "d"),
    ("distance", "distance_m", ".1f"),
    ("walking_time", "walking_time_s", ".1f"),
    ("up_time", "up_time_s", ".1f"),
    ("speed", "speed_m_s", ".3f"),
    ("cadence", "cadence_steps_min", ".1f"),
    ("step_length_left", "step_length_left_m", ".3f"),
    ("step_length_right", "step_length_right_m", ".3f"),
    ("step_time_left", "step_time_left_s", ".2f"),
    ("step_time_right", "step_time_right_s", ".2f"),
    ("step_length_asymmetry", "step_length_asymmetry_percent", ".1f"),
    ("step_time_asymmetry", "step_time_asymmetry_percent", ".1f"),
)
# Key of the wording and of its smallest change, kind of guided test, field of its result, format.
TESTS = (
    ("ten_metre_speed", GuidedTest.TEN_METRE_WALK, "speed_m_s", ".2f"),
    ("ten_metre_time", GuidedTest.TEN_METRE_WALK, "duration_s", ".1f"),
    ("six_minute_distance", GuidedTest.SIX_MINUTE_WALK, "distance_m", ".1f"),
    ("up_and_go_time", GuidedTest.TIMED_UP_AND_GO, "duration_s", ".1f"),
)
RATINGS = ("discomfort", "pain", "exertion")  # key of the wording, and field of SessionOutcomes
_NAMES = {field: key for key, field, _ in ROWS} | {name: name for name in RATINGS}
_NAMES |= {key: key for key, *_ in TESTS}


def lines_of(found: SessionOutcomes) -> Iterator[tuple[str, str]]:
    """Name with its unit, and value, of everything; the same names in the same order for each session."""
    yield from _measures(found.measures)
    for key, test, field, form in TESTS:
        yield tr(f"outcomes.{key}"), _shown(_tested(found, test, field), form)
    yield from _dose(found.dose)
    for name in RATINGS:
        yield tr(f"outcomes.{name}"), _shown(getattr(found, name), "d")


def outcomes_table(found: Sequence[SessionOutcomes]) -> Table:
    """Sessions side by side, actions below the measures."""
    table = Table(title=_plain(tr("outcomes.title", patient=found[0].patient), "table.title"))
    table.add_column(tr("outcomes.measure"))
    for one in found:
        table.add_column(_plain(one.began[:16].replace("T", " ")), justify="right")
    table.add_column(tr("outcomes.smallest_change"), justify="right")
    changes = changes_of()
    for line in zip(*(lines_of(one) for one in found), strict=True):
        name = line[0][0]
        table.add_row(name, *(value for _, value in line), changes.get(name, NONE))
    table.add_section()
    for action in dict.fromkeys(action for one in found for action in one.actions):
        table.add_row(
            _plain(render_recorded(Reason("report.action_name", {"action": action}))),
            *(str(one.actions.get(action, 0)) for one in found),
        )
    return table


def _plain(recorded: str, style: str = "") -> Text:
    """Shown as it is: brackets in what a trail holds are no markup."""
    return Text(sanitize_terminal(recorded), style)


def changes_of() -> dict[str, str]:
    """The smallest change that means something, by the name that a measure has in `lines_of`."""
    return {tr(f"outcomes.{_NAMES[field]}"): _least(field) for field in SMALLEST_CHANGES}


def remarks(found: Sequence[SessionOutcomes]) -> Iterator[tuple[str, dict[str, object]]]:
    """What a reader must know of each session: key and values of the wording."""
    for one in found:
        if one.joints_host:
            yield "outcomes.other_computer", {"session": one.session, "host": one.joints_host}
        elif one.source is OutcomeSource.TRAIL:
            yield "outcomes.trail_only", {"session": one.session}
        if one.source is OutcomeSource.CUT_RECORDING:
            yield "outcomes.cut", {"session": one.session, "measured_s": one.measured_s}
        if one.measures.steps == 0:
            yield "outcomes.no_walking", {"session": one.session}
        for result in one.tests:
            if result.outcome != COMPLETED:
                yield "outcomes.test_stopped", {"session": one.session, "result": result_text(result)}


def sources() -> Iterator[str]:
    """Where each smallest change comes from, and in whom it was found."""
    for change in dict.fromkeys(SMALLEST_CHANGES.values()):
        fields = [field for field, one in SMALLEST_CHANGES.items() if one is change]
        yield tr(
            "outcomes.change_source",
            measure=" / ".join(tr(f"outcomes.{_NAMES[field]}") for field in fields),
            least=_least(fields[0]),
            change=tr(change.kind),
            people=tr(change.found_in),
            source=change.source,
        )


def _measures(measures: Measures) -> Iterator[tuple[str, str]]:
    for key, field, form in ROWS:
        yield tr(f"outcomes.{key}"), _shown(getattr(measures, field), form)
    for joint in Joint:
        found = measures.range_of_motion.get(joint.name.lower())
        name = tr("outcomes.range", joint=joint)
        yield name, NONE if found is None else f"{found.range_deg:.1f} ({found.low_deg:.1f} … {found.high_deg:.1f})"


def _shown(value: float | None, form: str) -> str:
    return NONE if value is None else format(value, form)


def _dose(dose: Dose | None) -> Iterator[tuple[str, str]]:
    """Done beside the target, in the wording's unit, and per cent of it."""
    for key, unit, form in (("steps", 1, ".0f"), ("distance_m", 1, ".1f"), ("duration_s", 60, ".1f")):
        done = getattr(dose, key, None)
        target = getattr(dose.target, key) if dose else 0
        name = tr(f"outcomes.dose.{key}")
        if done is None or not target:
            yield name, NONE
        else:
            yield name, f"{done / unit:{form}} / {target / unit:{form}} ({done / target:.0%})"


def _least(field: str) -> str:
    change = SMALLEST_CHANGES[field]
    return f"±{change.least:.0%}" if change.relative else f"±{change.least:g}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """One measure, a value a session; None: not measured."""

    name: str  # with its unit
    form: str
    values: tuple[float | None, ...]
    smallest: SmallestChange | None = None

    @property
    def known(self) -> tuple[float, ...]:
        """Those that were measured."""
        return tuple(value for value in self.values if value is not None)

    @property
    def change(self) -> float | None:
        """From the first to the newest; None with fewer than two."""
        return self.known[-1] - self.known[0] if len(self.known) > 1 else None

    @property
    def least(self) -> float | None:
        """The smallest change that means something, from the first value on, in the measure's unit."""
        return self.smallest.of(self.known[0]) if self.smallest is not None and self.known else None


def series_of(found: Sequence[SessionOutcomes]) -> tuple[Series, ...]:
    """Every measure that at least one session has."""
    made = [
        _series(tr(f"outcomes.{key}"), form, [getattr(one.measures, field) for one in found], field)
        for key, field, form in ROWS
    ]
    made += [
        _series(tr("outcomes.range", joint=joint), ".1f", [_range_deg(one, joint) for one in found]) for joint in Joint
    ]
    made += [
        _series(tr(f"outcomes.{key}"), form, [_tested(one, test, field) for one in found], key)
        for key, test, field, form in TESTS
    ]
    made += [_series(tr(f"outcomes.{name}"), "d", [getattr(one, name) for one in found], name) for name in RATINGS]
    return tuple(series for series in made if series.known)


def _series(name: str, form: str, values: Sequence[float | None], changes: str = "") -> Series:
    return Series(name=name, form=form, values=tuple(values), smallest=SMALLEST_CHANGES.get(changes))


def _range_deg(one: SessionOutcomes, joint: Joint) -> float | None:
    found = one.measures.range_of_motion.get(joint.name.lower())
    return None if found is None else found.range_deg


def _tested(one: SessionOutcomes, test: GuidedTest, field: str) -> float | None:
    result = last_completed(one.tests, test)
    return None if result is None else getattr(result, field)
