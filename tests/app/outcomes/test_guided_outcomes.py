"""Guided tests from the trail to table, JSON, plots and report."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.outcomes.change import SMALLEST_CHANGES
from app.outcomes.guided import GuidedStop, GuidedTest, last_completed
from app.outcomes.session import find_outcomes
from app.outcomes.table import TESTS, series_of
from logs.reason import reason
from logs.records import GuidedTestResult
from testing.trails import write_sample

S_NS = 1_000_000_000


def result(test: GuidedTest, duration_s: float, distance_m: float, *, completed: bool = True) -> GuidedTestResult:
    walk = test is not GuidedTest.TIMED_UP_AND_GO
    return GuidedTestResult(
        test=test.value,
        outcome="completed" if completed else "stopped",
        reason=None if completed else reason(GuidedStop.BY_KEY),
        started_ns=S_NS,
        began_ns=2 * S_NS,
        ended_ns=2 * S_NS + round(duration_s * 1e9),
        duration_s=duration_s,
        distance_m=distance_m,
        steps=round(distance_m / 0.3),
        speed_m_s=distance_m / duration_s if walk else None,
    )


TEN = result(GuidedTest.TEN_METRE_WALK, 51.0, 10.2)
BETTER = result(GuidedTest.TEN_METRE_WALK, 40.8, 10.2)
SIX = result(GuidedTest.SIX_MINUTE_WALK, 360.0, 61.5)
BROKEN_OFF = result(GuidedTest.SIX_MINUTE_WALK, 100.0, 17.1, completed=False)
UP_AND_GO = result(GuidedTest.TIMED_UP_AND_GO, 71.3, 6.0)


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two sessions: of the same test the last completed one counts; one that was stopped does not."""
    home = tmp_path_factory.mktemp("home")
    write_sample(home, minutes=0.1, seed=1, of_console=(TEN, BROKEN_OFF))
    write_sample(home, minutes=0.1, seed=2, of_console=(TEN, SIX, BETTER, BROKEN_OFF, UP_AND_GO))
    return home


def run(*arguments: str) -> str:
    done = CliRunner().invoke(cli, list(arguments))
    assert done.exit_code == 0, done.output
    return done.output


def sessions(home: Path) -> list[str]:
    return [path.stem for path in sorted((home / "logs").glob("*-000?.jsonl"))]


def test_the_last_completed_one_of_a_kind_counts() -> None:
    assert last_completed((TEN, BETTER, BROKEN_OFF), GuidedTest.TEN_METRE_WALK) is BETTER
    assert last_completed((BROKEN_OFF,), GuidedTest.SIX_MINUTE_WALK) is None


def test_table_and_json(home: Path, tmp_path: Path) -> None:
    text = run("outcomes", "--patient", "P-017", "--home", str(home), "--json", str(tmp_path / "o.json"))
    rows = {line.split("│")[1].strip(): line.split("│")[2:-1] for line in text.splitlines() if line.startswith("│")}
    for name, values in {
        "10-metre walk test, speed, m/s": ["0.20", "0.25", "±0.05"],
        "10-metre walk test, time, s": ["51.0", "40.8", "–"],
        "6-minute walk test, distance, m": ["–", "61.5", "±20"],
        "Timed Up and Go without the turn, time, s": ["–", "71.3", "–"],
    }.items():
        assert [cell.strip() for cell in rows[name]] == values
    assert "stopped (stopped by key); time 100.0 s, distance 17.1 m" in text
    assert "Perera" in text
    first, second = json.loads((tmp_path / "o.json").read_bytes())
    assert [one["test"] for one in first["tests"]] == ["ten metre walk", "six minute walk"]
    assert second["tests"][2]["speed_m_s"] == 0.25


def test_plots_over_sessions(home: Path) -> None:
    found = [find_outcomes(home / "logs", name) for name in sessions(home)]
    series = {one.name: one for one in series_of(found)}
    speed = series["10-metre walk test, speed, m/s"]
    assert speed.known == pytest.approx((0.2, 0.25))
    assert speed.least == 0.05
    assert series["6-minute walk test, distance, m"].values == (None, 61.5)
    assert series["Timed Up and Go without the turn, time, s"].smallest is None  # none was published without the turn


def test_a_smallest_change_is_of_a_test(home: Path) -> None:
    assert {key for key, *_ in TESTS} & set(SMALLEST_CHANGES) == {"ten_metre_speed", "six_minute_distance"}


def test_the_report_prints_them(home: Path, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    run("audit", "report", sessions(home)[1], "--home", str(home), "-o", str(page))
    text = page.read_text()
    assert "6-minute walk test, distance, m" in text
    assert "61.5" in text
    assert "time 100.0 s" in text


@pytest.mark.parametrize(
    ("language", "wanted"),
    [
        ("en", "Timed Up and Go, without the turn: done; time 71.3 s, distance 6.0 m, steps 20, speed – m/s"),
        ("zh", "起立行走计时测试（不转身）"),
    ],
)
def test_the_trail_tells_them(home: Path, language: str, wanted: str) -> None:
    text = run("--language", language, "audit", "show", sessions(home)[1], "--home", str(home))
    assert wanted in " ".join(text.split())
    assert "stopped (stopped by key)" in text or language == "zh"
