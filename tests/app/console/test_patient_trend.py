"""What a patient's sessions came to: bars, days, who has waited longest; on the real screen by its keys."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.console.screens.dialogs import history_lines
from app.console.session_index import Records, SessionRecord
from app.console.widgets.patient_details import (
    BARS,
    NO_BAR,
    PatientOrder,
    ago,
    days_since,
    describe,
    in_order,
    last_cells,
    session_lines,
    sparkline,
    trend_lines,
    vocabulary_text,
)
from app.system.paths import Home
from app.system.vocabulary import VocabularyStatus
from app.text.catalogue import use_language
from profiles.schema import DEMO_PATIENT, Calibration, GestureUsed, HandUsed, Profile
from profiles.store import Change, ProfileStore, differences
from testing.authors import Named
from tests.app.console.conftest import Opener
from tests.app.system.test_vocabulary_status import ENROLLED
from tests.support.calibrations import calibrated_with

NOW = datetime(2026, 5, 20, 8, 0, tzinfo=UTC)


@pytest.fixture(autouse=True)
def use_zone() -> Iterator[Callable[[str], None]]:
    """Sets this process's time zone, UTC at first; POSIX: west of Greenwich is positive."""
    with pytest.MonkeyPatch.context() as patch:

        def use(name: str) -> None:
            patch.setenv("TZ", name)
            time.tzset()

        use("UTC0")
        yield use
    time.tzset()


def session(patient: str = "P-1", *, days_ago: float = 0, steps: int = 0, pain: int | None = None) -> SessionRecord:
    at = (NOW - timedelta(days=days_ago)).isoformat()
    return SessionRecord(session="S", patient=patient, at=at, steps=steps, pain=pain, note=f"{steps} well")


def test_a_bar_grows_with_its_value() -> None:
    assert sparkline([0, 50, 100]) == "▁▅█"
    assert sparkline([0, None, 5, 10], 10.0) == f"▁{NO_BAR}▅█"
    assert sparkline([]) == ""
    assert sparkline([0, 0]) == "▁▁"


@given(st.lists(st.none() | st.floats(0, 1e6), max_size=30), st.none() | st.floats(1, 1e3))
def test_bars_keep_the_order_of_their_values(values: list[float | None], most: float | None) -> None:
    bars = sparkline(values, most)
    assert len(bars) == len(values)
    assert all((bar == NO_BAR) == (value is None) for bar, value in zip(bars, values, strict=True))
    heights = sorted((value, BARS.index(bar)) for bar, value in zip(bars, values, strict=True) if value is not None)
    assert [height for _, height in heights] == sorted(height for _, height in heights)


def test_days_are_the_calendars() -> None:
    assert days_since("2026-05-19T23:59:00+00:00", NOW) == 1
    assert days_since("2026-05-20T00:01:00+02:00", NOW) == 1  # still the 19th here
    assert days_since("2026-05-18T12:00:00", NOW) == 2
    assert days_since("2026-05-21T12:00:00+00:00", NOW) == 0
    assert [ago((NOW - timedelta(days=days)).isoformat(), NOW) for days in (0, 1, 12)] == [
        "today",
        "1 day ago",
        "12 days ago",
    ]
    use_language("zh")
    assert ago((NOW - timedelta(days=3)).isoformat(), NOW) == "3 天前"


@pytest.mark.parametrize(
    ("zone", "when", "moment"), [("CST-8", "today", "2026-05-20 07:10"), ("EST5", "1 day ago", "2026-05-19 18:10")]
)
def test_days_and_times_are_those_of_the_computers_zone(
    use_zone: Callable[[str], None], zone: str, when: str, moment: str
) -> None:
    use_zone(zone)
    at = "2026-05-19T23:10:00+00:00"
    record = SessionRecord(session="S", patient="P-1", at=at)
    change = Change(at=at, by="Bea", changes={})
    assert ENROLLED.evidence is not None
    proven = msgspec.structs.replace(ENROLLED.evidence, proven_at=datetime.fromisoformat(at))
    enrolled = msgspec.structs.replace(ENROLLED, evidence=proven)
    assert last_cells((record,), NOW)[0] == when
    assert f"Last session {moment}\n" in str(describe(DEMO_PATIENT, (), (record,), NOW))
    assert session_lines((record, record))[0][0][0].strip() == moment[:10]
    assert history_lines((change,))[0][0][0] == f"{moment}  Bea"
    assert vocabulary_text(enrolled, VocabularyStatus.VALID, {}).endswith(f"proven on {moment[:10]}")


def test_a_time_that_is_none_stands_in_the_history_as_it_is() -> None:
    assert history_lines((Change(at="some day", by="Bea", changes={}),))[0][0][0] == "some day  Bea"


def _shown_changes(after: Profile) -> tuple[str, str]:
    """In the history, and beside the list."""
    change = Change(at="2026-05-20T10:00:00+00:00", by="Bea", changes=differences(DEMO_PATIENT, after))
    last = SessionRecord(session="S", patient="demo", at="2026-05-19T10:00:00+00:00")
    lines = ("".join(text for text, _ in line) for line in history_lines((change,))[1:])
    return "\n".join(lines), str(describe(DEMO_PATIENT, (change,), (last,), NOW))


@pytest.mark.parametrize(
    ("language", "hand", "archived", "vocabulary"),
    [
        ("en", ("Hand used", "right → left", "left"), ("Archived", "No → Yes", "Yes"), "0 1 love"),
        ("zh", ("发令手", "右 → 左", "左"), ("已归档", "否 → 是", "是"), "0 1 love"),
    ],
)
def test_a_change_is_told_in_the_words_of_the_form(
    language: str, hand: tuple[str, str, str], archived: tuple[str, str, str], vocabulary: str
) -> None:
    use_language(language)
    gestures = (GestureUsed.ZERO, GestureUsed.ONE, GestureUsed.LOVE)
    fields = {"hand": HandUsed.LEFT, "archived": True, "vocabulary": gestures, "note": "left side  weak"}
    history, details = _shown_changes(msgspec.structs.replace(DEMO_PATIENT, **fields))
    for name, change, new in (hand, archived):
        assert f"  {name}: {change}" in history.splitlines()
        assert f"  {name} → {new}" in details.splitlines()
    assert f"→ {vocabulary}\n" in history
    assert "→ left side  weak" in history


def test_a_new_patients_history_has_the_forms_units_and_nothing_of_the_file() -> None:
    created = Change(at="2026-05-20T10:00:00+00:00", by="Bea", changes=differences(None, DEMO_PATIENT))
    history = ["".join(text for text, _ in line) for line in history_lines((created,))]
    for told in ("Mass (kg): – → 65", "Step time (s): – → 2", "Distance (m): – → ", "Time (s): – → ", "Steps: – → "):
        assert [line for line in history if line.startswith(f"  {told}")], told
    assert "schema" in created.changes
    assert [line for line in history if "schema" in line] == []


def test_a_calibration_and_an_enrolment_are_named_without_their_figures() -> None:
    calibration = Calibration(
        camera="webcam", focal_anchor_px_m=36.0, focal_px=600.0, distance_m=0.36, residual=0.01, calibrated_at="now"
    )
    history, details = _shown_changes(msgspec.structs.replace(ENROLLED, calibrations=(calibration,)))
    for name in ("Calibrations of the palm", "Evidence of the gestures"):
        assert history.splitlines().count(f"  {name}") == 1
        assert details.splitlines().count(f"  {name}") == 1
    assert "webcam" not in history
    assert "600" not in history + details


@pytest.mark.parametrize(
    ("zone", "at"),
    [("UTC0", "gestern"), ("CST-8", "9999-12-31T23:59:00+00:00"), ("EST5", "0001-01-01T00:00:00+00:00")],
)
def test_a_time_that_is_none_stands_in_list_and_details_as_it_is(
    use_zone: Callable[[str], None], zone: str, at: str
) -> None:
    use_zone(zone)
    calibration = Calibration(
        camera="webcam", focal_anchor_px_m=36.0, focal_px=600.0, distance_m=0.36, residual=0.01, calibrated_at=at
    )
    calibrated = msgspec.structs.replace(DEMO_PATIENT, calibrations=(calibration,))
    assert f"Palm calibrated {at[:16]} with webcam\n" in str(describe(calibrated, (), (), NOW))
    assert last_cells((SessionRecord(session="S", patient="P-1", at=at),), NOW)[0] == at[:16]


def test_a_palm_is_as_accurate_as_its_newest_calibration_whose_camera_is_named() -> None:
    newest = calibrated_with(focal_anchor_px_m=36.0, calibrated_at="2026-05-20T06:00:00+00:00")
    older = msgspec.structs.replace(
        newest, camera="other", focal_anchor_px_m=38.0, calibrated_at="2026-05-01T06:00:00+00:00"
    )
    without = str(describe(DEMO_PATIENT, (), (), NOW))
    assert "estimated: distance ± 4 %" in without
    assert "Palm calibrated" not in without
    calibrated = msgspec.structs.replace(DEMO_PATIENT, calibrations=(newest, older))
    text = str(describe(calibrated, (), (), NOW))
    assert "Reference segment 6.0 cm, calibrated: distance ± 1 %\nPalm calibrated today with webcam\n" in text


def test_who_has_waited_longest_comes_first() -> None:
    last_at = {"B": "2026-05-01", "A": "2026-05-03", "C": ""}
    assert in_order(PatientOrder.IDENTIFIER, last_at) == ["A", "B", "C"]
    assert in_order(PatientOrder.WAITING, last_at) == ["C", "B", "A"]
    assert in_order(PatientOrder.RECENT, last_at) == ["A", "B", "C"]


def test_rows_that_were_never_asked_are_left_out() -> None:
    sessions = [session(days_ago=9, steps=40, pain=4), session(days_ago=2, steps=80)]
    text = ["".join(part for part, _ in line) for line in trend_lines(sessions)]
    assert text[1:] == ["The last 2 sessions", "Steps       ▅█  80", f"Pain        ▄{NO_BAR}  {NO_BAR}"]
    assert trend_lines(sessions[:1]) == []
    assert last_cells(sessions, NOW) == ("2 days ago", "▅█")
    assert last_cells((), NOW) == (NO_BAR, "")
    (line,) = session_lines(sessions)
    assert "".join(part for part, _ in line) == "2026-05-11  40 steps, 0.0 m, 0 min  “40 well”"


async def test_s_sorts_the_list_and_the_title_says_how(console: Opener, home: Home) -> None:
    store, records = ProfileStore(home.profiles), Records(home.root / "sessions", SessionRecord)
    for name, days_ago in (("P-1", 1.0), ("P-2", 30.0)):
        made = msgspec.structs.replace(DEMO_PATIENT, identifier=name)
        store.create(made, by=Named(""), at=NOW)
        at = datetime.now(UTC) - timedelta(days=days_ago)
        records.add(msgspec.structs.replace(session(name, steps=12), at=at.isoformat()))

    def first() -> str:
        return next(line for line in opened.text().splitlines() if line.strip().startswith(("P-", "demo"))).split()[0]

    async with console(profile=None, size=(120, 36)) as opened:
        await opened.shows("Patients, by identifier")
        await opened.shows("30 days ago")
        await opened.press("s")
        await opened.shows("longest without a session first")
        assert first() == "demo"  # who never had one
        await opened.press("s")
        await opened.shows("last session first")
        assert first() == "P-1"
        await opened.press("s")
        await opened.shows("Patients, by identifier")
        assert first() == "P-1"


async def test_a_file_of_sessions_that_is_broken_is_named_and_the_list_stays(console: Opener, home: Home) -> None:
    (home.root / "sessions").mkdir(parents=True)
    (home.root / "sessions" / "demo.jsonl").mkdir()
    async with console(profile=None, size=(120, 36)) as opened:
        await opened.shows("✗")
        await opened.shows("demo.jsonl")
        assert "female" in opened.text()
