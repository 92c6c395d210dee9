"""Questions over several sites: trails and Parquet together; a site that is not whole is refused by name."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import duckdb
import pytest

from logs import records_table
from logs.errors import AuditError, AuditFault
from logs.keys import by_fingerprint, known_keys
from logs.query import QUESTIONS, ask
from logs.read import outline, records
from logs.reason import key_of
from logs.records import ActionEnd
from logs.records_table import connect, export
from logs.sites import SITE_QUESTIONS, SiteState, check_site, connect_sites, find_sites
from logs.verify import Evidence
from testing.engines import write_sites
from testing.trails import write_sample


@pytest.fixture(scope="module")
def homes(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two sites with a session each."""
    found = tmp_path_factory.mktemp("north"), tmp_path_factory.mktemp("south")
    for seed, home in enumerate(found, start=1):
        write_sample(home, minutes=4, seed=seed)
    return found


def evidence(path: Path) -> Evidence:
    return Evidence(keys=by_fingerprint(known_keys(path.parent / "keys")))


def rows(texts: list[str], sql: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = ask(connect_sites(find_sites(texts)), sql).to_pylist()
    return found


def refusal(texts: list[str]) -> AuditError:
    def check_all() -> None:
        for site in find_sites(texts):
            check_site(site, evidence)

    with pytest.raises(AuditError) as raised:
        check_all()
    return raised.value


def test_sites_together_are_the_sum_of_each(homes: tuple[Path, Path], tmp_path: Path) -> None:
    export([homes[1] / "logs"], tmp_path / "south.parquet", drop_operators=False)
    texts = [f"north={homes[0]}", str(tmp_path / "south.parquet")]
    answer = rows(texts, SITE_QUESTIONS["sites"])
    assert [row["site"] for row in answer] == ["north", "south"]
    for row, home in zip(answer, homes, strict=True):
        (alone,) = ask(connect([home / "logs"]), "SELECT count(*) AS n FROM records").to_pylist()
        assert row["records"] == alone["n"]
        assert row["steps"] == outline(next((home / "logs").glob("2*.jsonl"))).steps


def test_steps_are_those_of_every_session_and_none_is_counted_again(tmp_path: Path) -> None:
    """An action's end holds the steps of its session so far."""
    trails = [write_sample(tmp_path, minutes=2, seed=seed) for seed in (1, 2)]
    (row,) = rows([f"a={tmp_path}"], SITE_QUESTIONS["sites"])
    walked = [
        sum("step" in one.body.action for one in records(trail) if isinstance(one.body, ActionEnd)) for trail in trails
    ]
    assert row["steps"] == sum(walked) > 6


def test_a_site_without_an_action_has_no_steps(tmp_path: Path) -> None:
    write_sample(tmp_path, minutes=0)
    (row,) = rows([f"a={tmp_path}"], SITE_QUESTIONS["sites"])
    assert (row["actions"], row["steps"]) == (0, 0)


@pytest.mark.parametrize("name", QUESTIONS)
def test_the_old_questions_give_the_old_answers(homes: tuple[Path, Path], name: str) -> None:
    old = ask(connect([home / "logs" for home in homes]), QUESTIONS[name]).to_pylist()
    assert rows([f"a={homes[0]}", f"b={homes[1]}"], SITE_QUESTIONS[name]) == old


def test_equal_counts_of_faults_stand_in_one_order(tmp_path: Path) -> None:
    found = rows([str(place) for place in write_sites(tmp_path, 60_000)], SITE_QUESTIONS["faults"])
    keys = [(-int(row["times"]), row["event"], row["effect"]) for row in found]
    assert len({key[:2] for key in keys}) < len(keys), "no event has as many faults that hold as that damp"
    assert keys == sorted(keys)


def test_what_is_known_of_a_site_is_told(homes: tuple[Path, Path], tmp_path: Path) -> None:
    export([homes[0] / "logs"], tmp_path / "x.parquet", drop_operators=False)
    sites = find_sites([f"north={homes[0]}", f"x={tmp_path}"])
    told = [check_site(site, evidence) for site in sites]
    assert [one.code for one in told] == [key_of(SiteState.PROVEN), key_of(SiteState.NOT_SIGNED)]


def test_more_trails_are_asked_than_memory_holds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(records_table._LIMITS, "memory_limit", "256MB")
    trail = write_sample(tmp_path, minutes=1)
    for number in range(99):
        shutil.copy(trail, trail.with_name(f"copy-{number}.jsonl"))
    (row,) = rows([f"a={tmp_path}"], SITE_QUESTIONS["sites"])
    assert row["records"] == 100 * len(list(records(trail)))


def test_without_a_public_key_nothing_is_proven(homes: tuple[Path, Path]) -> None:
    (site,) = find_sites([f"north={homes[0]}"])
    assert check_site(site, lambda _: Evidence()).code == key_of(SiteState.NOT_PROVEN)


def test_a_tampered_site_is_refused_by_name(homes: tuple[Path, Path], tmp_path: Path) -> None:
    path = write_sample(tmp_path, minutes=1)
    path.write_bytes(path.read_bytes().replace(b"Ann Berg", b"Ann Borg", 1))
    refused = refusal([f"north={homes[0]}", f"bad={tmp_path}"])
    assert (refused.code, refused.values["site"]) == (AuditFault.SITE_TAMPERED, "bad")
    path.unlink()  # the session is gone, and the manifest says so
    write_sample(tmp_path, minutes=1, seed=2)
    assert refusal([f"bad={tmp_path}"]).code is AuditFault.SITE_TAMPERED


def test_missing_empty_doubled_and_mixed_sites_are_refused(homes: tuple[Path, Path], tmp_path: Path) -> None:
    missing = refusal([f"north={homes[0]}", f"west={tmp_path / 'nowhere'}"])
    assert (missing.code, missing.values["site"]) == (AuditFault.SITE_MISSING, "west")
    assert refusal([str(tmp_path)]).code is AuditFault.SITE_EMPTY
    assert refusal([f"a={homes[0]}", f"a={homes[1]}"]).code is AuditFault.SITE_TWICE
    mixed = tmp_path / "mixed"
    mixed.mkdir()
    (mixed / "s.jsonl").touch()
    (mixed / "s.parquet").touch()
    assert refusal([str(mixed)]).code is AuditFault.SITE_AMBIGUOUS


def test_sites_that_share_a_file_are_refused(homes: tuple[Path, Path]) -> None:
    trail = next((homes[0] / "logs").glob("2*.jsonl"))
    for shared in (homes[0], homes[0] / "logs", trail):
        refused = refusal([f"a={homes[0]}", f"b={shared}", f"c={homes[1]}"])
        assert (refused.code, refused.values) == (AuditFault.SITES_SHARE, {"site": "a", "other": "b"})


def test_a_site_with_brackets_is_no_pattern_of_another(tmp_path: Path) -> None:
    for folder, seed in (("clinic[1]", 1), ("clinic1", 2)):
        write_sample(tmp_path / folder, minutes=1, seed=seed)
    export([tmp_path / "clinic1" / "logs"], tmp_path / "x1.parquet", drop_operators=False)
    (tmp_path / "x[1].parquet").write_bytes(b"none")
    files = rows([str(tmp_path / "clinic[1]")], "SELECT DISTINCT file FROM records")
    assert files == [{"file": str(path)} for path in (tmp_path / "clinic[1]" / "logs").glob("2*.jsonl")]
    assert refusal([str(tmp_path / "x[1].parquet")]).code is AuditFault.SITE_UNREADABLE


def test_a_site_is_called_as_its_folder_or_as_its_file_without_the_suffix(tmp_path: Path) -> None:
    for name in ("clinic.a", "clinic.b"):
        (tmp_path / name / "logs").mkdir(parents=True)
        (tmp_path / name / "logs" / "s.jsonl").touch()
    (tmp_path / "south.x.parquet").touch()
    texts = [str(tmp_path / part) for part in ("clinic.a", "clinic.b/logs", "south.x.parquet")]
    assert [site.name for site in find_sites(texts)] == ["clinic.a", "clinic.b", "south.x"]


def test_cut_foreign_and_newer_parquet_is_refused(tmp_path: Path) -> None:
    (place,) = write_sites(tmp_path, 500, sites=1)
    whole = place / "records.parquet"
    data = whole.read_bytes()
    whole.write_bytes(data[: len(data) // 2])
    assert refusal([str(place)]).code is AuditFault.SITE_UNREADABLE
    whole.write_bytes(data)
    foreign = tmp_path / "foreign.parquet"
    duckdb.sql(f"COPY (SELECT 1 AS a) TO '{foreign}'")
    assert refusal([str(foreign)]).code is AuditFault.NOT_AN_EXPORT
    newer = tmp_path / "newer.parquet"
    duckdb.sql(f"COPY (SELECT * REPLACE (99 AS schema) FROM '{whole}') TO '{newer}'")
    assert refusal([str(newer)]).code is AuditFault.SITE_NEWER


@pytest.mark.parametrize(
    "sql",
    [
        "DROP VIEW records",
        "COPY records TO 'x.csv'",
        "INSERT INTO records VALUES (1)",
        "SELECT 1; SELECT 2",
        "SELECT * FROM read_csv('/etc/passwd')",
        "SET memory_limit = '9GB'",
    ],
)
def test_a_question_reads_the_sites_and_nothing_else(homes: tuple[Path, Path], sql: str) -> None:
    with pytest.raises(AuditError) as raised:
        rows([f"north={homes[0]}"], sql)
    assert raised.value.code in (AuditFault.NOT_A_QUESTION, AuditFault.UNANSWERABLE)
