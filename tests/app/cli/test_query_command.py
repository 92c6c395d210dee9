"""`rleex query` as a person or a script calls it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.system.errors import AppError
from app.text.catalogue import render
from logs.errors import AuditError
from testing.trails import write_sample


@pytest.fixture(scope="module")
def homes(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    found = tmp_path_factory.mktemp("north"), tmp_path_factory.mktemp("south")
    for seed, home in enumerate(found, start=1):
        write_sample(home, minutes=2, seed=seed)
    return found


def query(*arguments: str) -> tuple[int, str, str]:
    """Exit status, standard output, and what went to standard error or was refused."""
    result = CliRunner().invoke(cli, ["query", *arguments])
    refused = isinstance(result.exception, AuditError | AppError)
    return result.exit_code, result.stdout, result.stderr + (render(result.exception) if refused else "")


def test_a_ready_question_over_two_sites(homes: tuple[Path, Path]) -> None:
    status, said, told = query(f"north={homes[0]}", f"south={homes[1]}", "--ask", "sites", "--json")
    assert status == 0
    assert [json.loads(line)["site"] for line in said.splitlines()] == ["north", "south"]
    assert told.splitlines() == ["north: 1 sessions, proven", "south: 1 sessions, proven"]
    status, said, _ = query(f"north={homes[0]}", "--sql", "SELECT site, count(*) AS n FROM records GROUP BY site")
    assert (status, "north" in said) == (0, True)


def test_the_home_is_the_site_when_none_is_named(homes: tuple[Path, Path]) -> None:
    status, said, _ = query("--home", str(homes[0]), "--ask", "sites", "--json")
    assert (status, len(said.splitlines())) == (0, 1)


def test_one_site_is_not_asked_to_compare_sites(homes: tuple[Path, Path]) -> None:
    result = CliRunner().invoke(cli, ["audit", "query", "--home", str(homes[0]), "--ask", "sites"])
    assert isinstance(result.exception, AppError)
    assert "`rleex query --ask sites`" in render(result.exception)


def test_what_can_not_be_asked_ends_with_one_sentence(homes: tuple[Path, Path], tmp_path: Path) -> None:
    north = f"north={homes[0]}"
    told = {
        "missing: there is no": query(north, f"west={tmp_path / 'west'}", "--ask", "sites"),
        "holds no sessions": query(str(tmp_path), "--ask", "sites"),
        "--ask": query(north),
        "sites of": query(north, "--ask", "nonsense"),
        "Only one SELECT over": query(north, "--sql", "DROP VIEW records"),
    }
    for words, (status, said, why) in told.items():
        assert status != 0
        assert not said
        assert words.split()[0] in why, (words, why)


def test_a_tampered_site_is_named_and_nothing_is_answered(homes: tuple[Path, Path], tmp_path: Path) -> None:
    path = write_sample(tmp_path, minutes=1)
    path.write_bytes(path.read_bytes().replace(b"Ann Berg", b"Ann Borg", 1))
    status, said, why = query(f"north={homes[0]}", f"bad={tmp_path}", "--ask", "sites")
    assert status != 0
    assert not said
    assert "Site bad is not sound" in why


def test_spark_without_java_or_without_its_extra_is_one_sentence(
    homes: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked = (f"north={homes[0]}", "--ask", "sites", "--spark", "local[1]")
    monkeypatch.delenv("JAVA_HOME", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    status, said, why = query(*asked)
    assert (status != 0, said) == (True, "")
    assert "Spark needs Java" in why
    monkeypatch.setenv("JAVA_HOME", str(tmp_path))
    monkeypatch.setitem(sys.modules, "pyspark.sql", None)
    status, said, why = query(*asked)
    assert (status != 0, said) == (True, "")
    assert "Spark is not installed" in why
