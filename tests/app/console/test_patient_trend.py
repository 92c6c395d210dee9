"""What a patient's sessions came to: bars, days, who has waited longest; on the real screen by its keys."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import msgspec
from hypothesis import given
from hypothesis import strategies as st

from app.console.session_index import Records, SessionRecord
from app.console.widgets.patient_details import (
    BARS,
    NO_BAR,
    PatientOrder,
    ago,
    days_since,
    in_order,
    last_cells,
    session_lines,
    sparkline,
    trend_lines,
)
from app.system.paths import Home
from app.text.catalogue import use_language
from profiles.schema import DEMO_PATIENT
from profiles.store import ProfileStore
from testing.authors import Named
from tests.app.console.conftest import Opener

NOW = datetime(2026, 5, 20, 8, 0, tzinfo=UTC)


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
    assert days_since("2026-05-20T00:01:00+02:00", NOW) == 1  # still the 19th in UTC
    assert days_since("2026-05-18T12:00:00", NOW) == 2
    assert days_since("2026-05-21T12:00:00+00:00", NOW) == 0
    assert [ago((NOW - timedelta(days=days)).isoformat(), NOW) for days in (0, 1, 12)] == [
        "today",
        "1 day ago",
        "12 days ago",
    ]
    use_language("zh")
    assert ago((NOW - timedelta(days=3)).isoformat(), NOW) == "3 天前"


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
