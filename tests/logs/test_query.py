"""Questions over many sessions, over trails and over Parquet."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs
from rich.text import Text

from app.ipc.states import ConsoleChange, RequestRefusal
from app.text.recorded import render_recorded
from logs import records as r
from logs.disk import Disk
from logs.errors import AuditError, AuditFault
from logs.journal import CHANGES, Moment, append_signed
from logs.keys import load_or_make_key
from logs.mirror import CheckpointCopy
from logs.query import QUESTIONS, as_json, as_table, ask
from logs.read import records, session_paths
from logs.reason import Reason, reason
from logs.records_table import connect, export, lines_of, omitted_lines
from logs.writer import SessionWriter
from testing.trails import write_sample
from tests.support.audit_trails import START, moment, write_session

COUNT = "SELECT count(*) AS n FROM records"


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two sessions of one patient."""
    home = tmp_path_factory.mktemp("home")
    for seed in (1, 2):
        write_sample(home, minutes=12, seed=seed)
    return home / "logs"


@pytest.fixture(scope="module")
def bodies(logs: Path) -> list[r.Body]:
    """Everything in them."""
    return [record.body for path in session_paths(logs) for record in records(path)]


def rows(table: Any) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = table.to_pylist()
    return found


def test_sql_sees_every_record(logs: Path, bodies: list[r.Body]) -> None:
    connection = connect([logs])
    (row,) = rows(ask(connection, "SELECT count(*) AS n, count(DISTINCT patient) AS p, min(patient) AS w FROM records"))
    assert row == {"n": len(bodies), "p": 1, "w": "P-017"}


def test_the_refusal_rate_is_that_of_the_records(logs: Path, bodies: list[r.Body]) -> None:
    connection = connect([logs])
    for row in rows(ask(connection, QUESTIONS["refusals"])):
        refused = sum(isinstance(b, r.Refusal) and b.gesture == row["gesture"] for b in bodies)
        later = sum(isinstance(b, r.Refusal) and b.gesture == row["gesture"] and b.number > 0 for b in bodies)
        requests = refused - later + sum(isinstance(b, r.Command) and b.gesture == row["gesture"] for b in bodies)
        assert (row["refused"], row["requests"]) == (refused, requests)
        assert row["rate"] == pytest.approx(refused / requests)


def test_a_file_whose_name_is_no_text_is_no_session(tmp_path: Path) -> None:
    """Verification names it as added; questions go on without it."""
    (trail := write_sample(tmp_path, minutes=1)).with_name(os.fsdecode(b"\xff.jsonl")).write_bytes(trail.read_bytes())
    assert session_paths(trail.parent) == [trail]
    (row,) = rows(ask(connect([trail.parent]), COUNT))
    assert row == {"n": len(list(records(trail)))}


def test_a_request_that_was_granted_and_then_refused_counts_once(tmp_path: Path) -> None:
    key = load_or_make_key(tmp_path / "keys")
    granted = r.Command(number=1, action="walk", source="gesture", gesture="5", state="standing")
    refused = r.Refusal(
        number=1, action="walk", source="gesture", gesture="5", reason=reason(RequestRefusal.COMING_TO_REST)
    )
    write_session(tmp_path, "s1", key, Disk(), (granted, refused, structs.replace(granted, number=2)))
    (row,) = rows(ask(connect([tmp_path / "s1.jsonl"]), QUESTIONS["refusals"]))
    assert row == {"gesture": "5", "requests": 2, "refused": 1, "rate": 0.5}


def test_hours_of_a_session_on_two_computers_count_once(tmp_path: Path) -> None:
    for computer, process in (("laptop", "perception"), ("joints", "control")):
        home = tmp_path / computer
        (home / "logs").mkdir(parents=True)
        writer = SessionWriter(home / "logs", "s1", load_or_make_key(home / "keys"), Disk(), CheckpointCopy(""))
        writer.begin(START, moment(0))
        writer.take(
            structs.replace(moment(1).entry(r.EventRaised(event="stop", effect="hold", text="")), process=process)
        )
        last = Moment(wall_ns=1, monotonic_ns=moment(0).monotonic_ns + 3600 * 10**9)
        writer.end("test", last)
        assert writer.finish(last)
        writer.close()
    (row,) = rows(ask(connect([tmp_path / "laptop" / "logs", tmp_path / "joints" / "logs"]), QUESTIONS["faults"]))
    assert (row["times"], row["device_hours"]) == (2, pytest.approx(1.0))


def test_a_rate_over_nothing_is_none(tmp_path: Path) -> None:
    """A trail that was cut may have the refusal without its request, or one record alone."""
    key = load_or_make_key(tmp_path / "keys")
    refused = r.Refusal(
        number=1, action="walk", source="gesture", gesture="5", reason=reason(RequestRefusal.COMING_TO_REST)
    )
    lost = r.EventRaised(event="lost", effect="hold", text="Look.")
    append_signed(tmp_path / "s1.jsonl", "s1", [refused, lost], key, Moment(wall_ns=1, monotonic_ns=1))
    connection = connect([tmp_path / "s1.jsonl"])
    (rates,) = as_json(ask(connection, QUESTIONS["refusals"]))
    assert json.loads(rates) == {"gesture": "5", "requests": 0, "refused": 1, "rate": None}
    (faults,) = rows(ask(connection, QUESTIONS["faults"]))
    assert (faults["times"], faults["per_hour"]) == (1, None)


def test_response_and_faults_are_those_of_the_records(logs: Path, bodies: list[r.Body]) -> None:
    connection = connect([logs])
    ends = [b for b in bodies if isinstance(b, r.ActionEnd)]
    days = rows(ask(connection, QUESTIONS["response"]))
    assert sum(day["actions"] for day in days) == len(ends)
    assert max(day["longest_ms"] for day in days) == pytest.approx(
        max((end.first_command_ns - end.released_ns) / 1e6 for end in ends)
    )
    faults = rows(ask(connection, QUESTIONS["faults"]))
    assert sum(fault["times"] for fault in faults) == sum(isinstance(b, r.EventRaised) for b in bodies)
    unintended = rows(ask(connection, QUESTIONS["unintended"]))
    assert [row["stopped"] for row in unintended] == [0, 0]


def test_parquet_gives_the_same_answers(logs: Path, tmp_path: Path) -> None:
    parquet = tmp_path / "records.parquet"
    export([logs], parquet, drop_operators=False)
    for question in QUESTIONS.values():
        direct = rows(ask(connect([logs]), question))
        assert rows(ask(connect([parquet]), question)) == direct


def test_trails_named_beside_parquet_count_as_well(logs: Path, tmp_path: Path) -> None:
    parquet = tmp_path / "records.parquet"
    export([logs], parquet, drop_operators=False)
    counts = "SELECT session, count(*) AS n FROM records GROUP BY session ORDER BY session"
    alone, both = rows(ask(connect([logs]), counts)), rows(ask(connect([parquet, logs]), counts))
    assert both == [{"session": one["session"], "n": 2 * one["n"]} for one in alone]


def test_parquet_of_any_name_is_read_as_parquet(logs: Path, tmp_path: Path) -> None:
    for name in ("records.parquet", "records.PARQUET", "records.pq"):
        export([logs], tmp_path / name, drop_operators=False)
        assert rows(ask(connect([tmp_path / name]), COUNT)) == rows(ask(connect([logs]), COUNT))
        assert not lines_of([tmp_path / name])


def test_a_path_that_goes_up_again_counts_as_its_folder(logs: Path, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(logs)  # its `..` is the parent of what it points to
    for place in (logs / ".." / logs.name, tmp_path / "link" / ".." / logs.name):
        connection = connect([place])
        assert rows(ask(connection, COUNT)) == rows(ask(connect([logs]), COUNT))
        assert not omitted_lines(connection, lines_of([place]))


def test_a_path_with_brackets_is_no_pattern_of_another(tmp_path: Path) -> None:
    key = load_or_make_key(tmp_path / "keys")
    for folder in ("clinic1", "clinic[1]", "clinic?", "clinic*"):
        (tmp_path / folder).mkdir()
        write_session(tmp_path / folder, "s1", key, Disk(), (r.Note(text=folder),))
    for folder in ("clinic[1]", "clinic?", "clinic*"):
        export([tmp_path / folder], tmp_path / f"{folder}.parquet", drop_operators=False)
        for place in (tmp_path / folder, tmp_path / folder / "s1.jsonl", tmp_path / f"{folder}.parquet"):
            answer = rows(ask(connect([place]), "SELECT DISTINCT file, text FROM records WHERE kind = 'note'"))
            assert answer == [{"file": str(tmp_path / folder / "s1.jsonl"), "text": folder}]


def test_what_is_named_twice_counts_once(logs: Path, tmp_path: Path) -> None:
    export([logs], tmp_path / "records.parquet", drop_operators=False)
    link = tmp_path / "link.parquet"
    link.symlink_to(tmp_path / "records.parquet")
    once = rows(ask(connect([logs]), COUNT))
    assert rows(ask(connect([logs, logs, *session_paths(logs)]), COUNT)) == once
    assert rows(ask(connect([link, tmp_path / "records.parquet"]), COUNT)) == once


def test_operators_can_be_left_out_and_pseudonyms_stay(logs: Path, tmp_path: Path) -> None:
    parquet = tmp_path / "records.parquet"
    export([logs], parquet, drop_operators=True)
    connection = connect([parquet])
    answer = rows(ask(connection, "SELECT DISTINCT operator, patient FROM records"))
    assert answer == [{"operator": "", "patient": "P-017"}]
    assert b"Ann Berg" not in parquet.read_bytes()


def test_a_changed_operators_name_is_left_out_too(tmp_path: Path) -> None:
    key, parquet = load_or_make_key(tmp_path / "keys"), tmp_path / "records.parquet"
    bodies: list[r.Body] = [
        r.Change(subject="operator", name="Ann Berg", values={"enabled": (True, False)}, proof="pin"),
        r.Change(subject="patient", name="P-017", values={"mass_kg": (65.0, 71.0)}, proof="pin"),
    ]
    append_signed(tmp_path / CHANGES, "changes", bodies, key, Moment(wall_ns=1, monotonic_ns=1, operator="Ann Berg"))
    export([tmp_path / CHANGES], parquet, drop_operators=True)
    assert b"Ann Berg" not in parquet.read_bytes()
    (row,) = rows(ask(connect([parquet]), "SELECT body->>'$.name' AS name FROM records WHERE body LIKE '%mass_kg%'"))
    assert row["name"] == "P-017"


def test_the_name_of_who_took_over_is_left_out_too(tmp_path: Path) -> None:
    key, parquet = load_or_make_key(tmp_path / "keys"), tmp_path / "records.parquet"
    taken = r.Note(text=reason(ConsoleChange.TAKEN_OVER, operator="Ann Berg", lease=2))
    write_session(tmp_path, "s1", key, Disk(), (taken, r.Note(text=reason(ConsoleChange.NOBODY_CAME))))
    export([tmp_path / "s1.jsonl"], parquet, drop_operators=True)
    assert b"Ann Berg" not in parquet.read_bytes()
    assert b"NOBODY_CAME" in parquet.read_bytes()


def test_the_name_of_whose_lock_it_is_is_left_out_of_the_reason_too(tmp_path: Path) -> None:
    key, parquet = load_or_make_key(tmp_path / "keys"), tmp_path / "records.parquet"
    failed = r.SignInFailed(
        name="Tom Roth", reason=Reason("SignInFault.LOCKED_BY_ANOTHER", {"name": "Ann Berg"}), failures=0, wait_s=0.0
    )
    cancelled = r.Cancel(reason="too short")
    write_session(tmp_path, "s1", key, Disk(), (failed, cancelled))
    export([tmp_path / "s1.jsonl"], parquet, drop_operators=True)
    assert not any(name in parquet.read_bytes() for name in (b"Ann Berg", b"Tom Roth"))
    sql = "SELECT kind, reason FROM records WHERE kind IN ('cancel', 'sign-in-failed') ORDER BY kind"
    assert [row["reason"] for row in rows(ask(connect([parquet]), sql))] == ["too short", None]


def test_torn_and_foreign_lines_become_no_rows(logs: Path, tmp_path: Path) -> None:
    torn = tmp_path / "torn.jsonl"
    whole = session_paths(logs)[0].read_bytes()
    torn.write_bytes(whole + b'{"body":{"kind":"no')
    connection = connect([torn])
    (row,) = rows(ask(connection, "SELECT count(*) AS n FROM records"))
    assert row["n"] == whole.count(b"\n")


def test_a_line_that_does_not_match_its_hash_becomes_no_row(tmp_path: Path) -> None:
    key, parquet = load_or_make_key(tmp_path / "keys"), tmp_path / "records.parquet"
    path = write_session(tmp_path, "s1", key, Disk(), (r.PatientChosen(patient="P-1"), r.Note(text="ä–語")))
    whole = len(records(path))
    path.write_bytes(path.read_bytes().replace(b"P-1", b"P-2"))
    lines = lines_of([path])
    export([path], parquet, drop_operators=False)
    for source in (path, parquet):
        connection = connect([source])
        answer = rows(ask(connection, "SELECT patient, count(*) AS n FROM records GROUP BY patient"))
        assert answer == [{"patient": "", "n": whole - 1}]
    assert omitted_lines(connect([path]), lines) == {str(path): 1}


def test_a_damaged_line_is_left_out_whole_and_one_too_long_for_the_engine_names_its_file(tmp_path: Path) -> None:
    path = write_sample(tmp_path, minutes=1)
    whole = len(records(path))
    with path.open("ab") as file:
        file.write(b"x" * (15 << 20) + b"\n")
    lines = lines_of([path])
    connection = connect([path.parent])
    assert rows(ask(connection, COUNT)) == [{"n": whole}]
    assert omitted_lines(connection, lines) == {str(path): 1}
    with path.open("ab") as file:
        file.write(b"x" * (70 << 20) + b"\n")
    with pytest.raises(AuditError) as raised:
        lines_of([path.parent])
    assert raised.value.code is AuditFault.LINE_TOO_LONG
    assert raised.value.values["path"] == path


@pytest.mark.parametrize("sql", ["SELECT nonsense FROM records", "SELEC 1", "DROP TABLE nothing", "SELECT \udcff"])
def test_a_bad_question_is_refused(logs: Path, sql: str) -> None:
    connection = connect([logs])
    with pytest.raises(AuditError) as raised:
        ask(connection, sql)
    assert raised.value.code in (AuditFault.UNANSWERABLE, AuditFault.NOT_A_QUESTION)


def test_columns_of_one_name_keep_each_its_value(logs: Path) -> None:
    answer = ask(connect([logs]), "SELECT 1 AS n, 'two' AS n, 3 AS n_2, 4 AS n")
    table = as_table(answer, render_recorded)
    cells = [cell.plain for column in table.columns for cell in column.cells if isinstance(cell, Text)]
    assert cells == ["1", "two", "3", "4"]
    assert [column.justify for column in table.columns] == ["right", "left", "right", "right"]
    (row,) = as_json(answer)
    assert json.loads(row) == {"n": 1, "n_3": "two", "n_2": 3, "n_4": 4}


@pytest.mark.parametrize(
    "value",
    ["DATE '5000000-01-01'", "'infinity'::TIMESTAMP", "[DATE '5000000-01-01']", "{'day': DATE '0044-03-15 (BC)'}"],
)
def test_a_time_beyond_pythons_years_is_refused_by_its_column(logs: Path, value: str) -> None:
    connection = connect([logs])
    answer = ask(connection, f"SELECT 1 AS one, {value} AS far")
    for shown in (lambda: as_table(answer, render_recorded), lambda: list(as_json(answer))):
        with pytest.raises(AuditError) as raised:
            shown()
        assert (raised.value.code, raised.value.values) == (AuditFault.TIME_NOT_SHOWN, {"column": "far"})
    (row,) = as_json(ask(connection, "SELECT (DATE '5000000-01-01')::VARCHAR AS far"))
    assert json.loads(row) == {"far": "5000000-01-01"}


def test_json_has_null_for_what_is_no_finite_number(logs: Path) -> None:
    sql = (
        "SELECT 'nan'::DOUBLE AS a, ['inf'::FLOAT, 1.5] AS b, {'c': '-inf'::DOUBLE} AS d, MAP {'e': 'nan'::DOUBLE} AS f"
    )
    (row,) = as_json(ask(connect([logs]), sql))
    assert row == '{"a": null, "b": [null, 1.5], "d": {"c": null}, "f": [["e", null]]}'


def test_nothing_to_read_is_refused(tmp_path: Path) -> None:
    with pytest.raises(AuditError) as raised:
        connect([tmp_path])
    assert raised.value.code is AuditFault.NO_TRAILS
    with pytest.raises(AuditError) as raised:
        connect([tmp_path / "gone.jsonl"])
    assert raised.value.code is AuditFault.TRAIL_MISSING
