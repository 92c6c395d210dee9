"""Bad input at the command line's doors: one sentence and status 2 before any work, and nothing written."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from app.cli import main
from app.cli.common import CliFault
from app.cli.tree import tree
from app.evaluate.harness import EvaluateFault, kept_lines
from app.recording.schemas import TOPICS
from app.recording.writer import RecordingWriter
from app.system.errors import AppError
from app.system.paths import LockFault, find_home
from app.text.catalogue import render
from logs import records_table
from logs.errors import AuditError, AuditFault
from logs.query import ask, connect_locked
from testing.trails import write_sample
from tests.support.bad_input import NODES, in_time

ROOT = Path(__file__).parents[1]
SCHEMA1 = ROOT / "tests/logs/data/schema1"


def command_line(
    arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> tuple[object, str]:
    """Exit status and stderr of `rleex` in this process."""
    monkeypatch.setattr(sys, "argv", ["rleex", *arguments])
    with in_time(), pytest.raises(SystemExit) as caught:
        main()
    return caught.value.code, capsys.readouterr().err


DOORS: dict[str, tuple[str, ...]] = {
    "import": ("profile", "import", "{file}"),
    "show": ("audit", "show", "{file}"),
    "key": ("audit", "verify", "{home}", "--key", "{file}"),
    "query": ("audit", "query", "select 1", "--at", "{file}"),
    "export trail": ("audit", "export", "--parquet", "{home}/x.parquet", "--at", "{file}"),
    "report": ("audit", "report", "{file}", "-o", "{home}/x.html"),
    "decode": ("can", "decode", "{file}"),
    "decode device": ("can", "decode", "{home}/x.log", "--device", "{file}"),
    "emulate device": ("emulate-drives", "--device", "{file}"),
    "simulate gait": ("simulate", "walk", "--gait", "{file}"),
    "simulate profile": ("simulate", "walk", "--profile", "{file}"),
    "gestures": ("evaluate", "gestures", "{file}"),
    "finding": ("evaluate", "finding", "{file}", "--digital", "1000"),
    "distance": ("evaluate", "distance", "{file}"),
    "video": ("evaluate", "video", "{file}"),
    "camera": ("camera", "show", "{file}"),
    "home": ("locate", "--home", "{file}"),
}


@pytest.mark.parametrize("node", ["pipe", "endless device"])
@pytest.mark.parametrize("door", DOORS)
def test_no_door_opens_to_a_pipe_or_a_device(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], door: str, node: str
) -> None:
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.setenv("RLEEX_HOME", str(home))
    path = tmp_path / "x.toml"
    NODES[node](path)
    arguments = [part.format(file=path, home=home) for part in DOORS[door]]
    status, err = command_line(arguments, monkeypatch, capsys)
    assert status == 2, err
    assert err.startswith("rleex: "), err
    assert len(err.splitlines()) == 1
    assert not list(home.iterdir())


def _commands(group: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from _commands(command, (*path, name))
        else:
            yield (*path, name), command


COMMANDS = dict(_commands(typer.main.get_group(tree())))
WRITTEN = {"json", "json_file", "plot", "plot_file", "png", "video", "output", "errors", "keypoints", "parquet"}
OUTPUTS = [
    (path, parameter.name)
    for path, command in COMMANDS.items()
    for parameter in command.params
    if parameter.name in WRITTEN and not getattr(parameter, "is_flag", False)
]
HOMES = [path for path, command in COMMANDS.items() if any(one.name == "home" for one in command.params)]
FLOATS = [
    (path, parameter.name)
    for path, command in COMMANDS.items()
    for parameter in command.params
    if parameter.bare_type() == "float"
]
SEEDS = [
    (path, parameter.name)
    for path, command in COMMANDS.items()
    for parameter in command.params
    if "seed" in parameter.name and parameter.bare_type() == "int"
]


def arguments_of(path: tuple[str, ...], name: str, value: str) -> list[str]:
    """One option of a command, and anything for the arguments and options that it must have."""
    arguments: list[str] = []
    for parameter in COMMANDS[path].params:
        if parameter.name == name:
            arguments += [parameter.opts[0], value] if parameter.param_type_name == "option" else [value]
        elif parameter.required:
            some = "1" if parameter.bare_type() in {"int", "float"} else "x"
            some = {"to": "csv", "sex": "female"}.get(parameter.name, some)
            arguments += [parameter.opts[0], some] if parameter.param_type_name == "option" else [some]
    return arguments


def call(path: tuple[str, ...], name: str, value: str) -> None:
    """A command with these."""
    with in_time():
        COMMANDS[path].main(arguments_of(path, name, value), standalone_mode=False)


@pytest.mark.parametrize(("path", "name"), OUTPUTS)
@pytest.mark.parametrize("place", ["file/x", "no/x", "folder"])
def test_an_output_that_can_not_be_written_is_refused_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: tuple[str, ...], name: str, place: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    Path("folder").mkdir()
    if (name == "errors" or path == ("export",)) and place != "file/x":
        pytest.skip("a folder that is made")
    with pytest.raises(AppError) as caught:
        call(path, name, place)
    assert caught.value.code is CliFault.OUTPUT_UNWRITABLE
    assert sorted(one.name for one in tmp_path.rglob("*")) == ["file", "folder"]


EVIDENCE = ("logs/s.jsonl", "logs/s.mcap", "s.can.log", "keys/operators.json", "keys/ends/manifest.jsonl.json", "link")
REPLACED = [(path, name) for path, name in OUTPUTS if name not in {"errors", "keypoints"} and path != ("export",)]


@pytest.mark.parametrize(
    ("path", "name", "place"),
    [(*option, EVIDENCE[0]) for option in REPLACED] + [(*REPLACED[0], place) for place in EVIDENCE[1:]],
)
def test_an_output_that_is_evidence_is_refused_and_an_older_result_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: tuple[str, ...], name: str, place: str
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("RLEEX_HOME", str(tmp_path / "home"))
    for file in (*EVIDENCE[:-1], "keys/console.key", "logs/older.png"):
        Path(file).parent.mkdir(parents=True, exist_ok=True)
        Path(file).write_text("kept")
    Path("link").symlink_to("logs/s.jsonl")
    with pytest.raises(AppError) as caught:
        call(path, name, place)
    assert caught.value.code is CliFault.OUTPUT_IS_EVIDENCE
    assert {Path(file).read_text() for file in EVIDENCE} == {"kept"}
    older = Path("logs/older.png")
    assert COMMANDS[path].make_context("", arguments_of(path, name, str(older))).params[name] == older


@pytest.mark.parametrize("place", ["logs/s.jsonl", "logs/s.mcap", "logs/s.can.log", "keys/operators.json"])
def test_a_record_of_a_bus_goes_on_in_its_own_file_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    monkeypatch.chdir(tmp_path)
    for file in ("logs/s.jsonl", "logs/s.mcap", "logs/s.can.log", "keys/operators.json", "keys/console.key"):
        Path(file).parent.mkdir(parents=True, exist_ok=True)
        Path(file).touch()
    bench = Path("logs/bench.can.log")
    bench.touch()
    path = ("can", "record")
    assert COMMANDS[path].make_context("", arguments_of(path, "file", str(bench))).params["file"] == bench
    with pytest.raises(AppError) as caught:
        call(path, "file", place)
    assert caught.value.code is CliFault.OUTPUT_IS_EVIDENCE


@pytest.mark.parametrize("command", ["idle", "foreign", "response"])
def test_what_a_command_goes_on_from_may_have_any_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    monkeypatch.chdir(tmp_path)
    kept, path = Path("kept.jsonl"), ("evaluate", command)
    kept.touch()
    assert COMMANDS[path].make_context("", arguments_of(path, "keep", str(kept))).params["keep"] == kept


@pytest.mark.parametrize(
    ("command", "options"),
    [
        ("response", ("--keep", "--json")),
        ("foreign", ("--json", "--keep")),
        ("idle", ("--progress", "--json")),
        ("trigger", ("--json", "--plot")),
        ("gestures", ("--keypoints", "--json")),
        ("gestures", ("--json", "--with-keypoints")),
    ],
)
@pytest.mark.parametrize("there", [False, True])
def test_one_file_for_two_options_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, options: tuple[str, str], *, there: bool
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("here").symlink_to(".")
    if there:
        Path("x.png").write_text("kept")
    with pytest.raises(AppError) as caught:
        COMMANDS["evaluate", command].make_context("", [options[0], "x.png", options[1], "here/x.png"])
    assert (caught.value.code, caught.value.values["path"]) == (CliFault.OUTPUT_TWICE, Path("here/x.png"))
    assert not there or Path("x.png").read_text() == "kept"


@pytest.mark.parametrize(
    ("path", "name"),
    [
        (("can", "record"), "file"),
        (("evaluate", "response"), "keep"),
        (("evaluate", "foreign"), "keep"),
        (("evaluate", "gestures"), "keypoints"),
        (("evaluate", "gestures"), "beside_keypoints"),
        (("evaluate", "side"), "keypoints"),
    ],
)
def test_a_file_that_is_added_to_or_read_needs_a_folder_that_takes_new_ones_only_where_it_is_new(
    path: tuple[str, ...], name: str
) -> None:
    there = Path("/proc/self/comm")
    assert COMMANDS[path].make_context("", arguments_of(path, name, str(there))).params[name] == there
    with pytest.raises(AppError) as caught:
        COMMANDS[path].make_context("", arguments_of(path, name, "/proc/self/new"))
    assert caught.value.code is CliFault.OUTPUT_UNWRITABLE


@pytest.mark.parametrize("path", HOMES, ids=" ".join)
def test_a_home_that_is_a_file_is_refused_before_the_work(tmp_path: Path, path: tuple[str, ...]) -> None:
    file = tmp_path / "file"
    file.write_text("kept")
    with pytest.raises(AppError) as caught:
        call(path, "home", str(file))
    assert caught.value.code is LockFault.NO_FOLDER
    assert [one.name for one in tmp_path.rglob("*")] == ["file"]
    assert file.read_text() == "kept"


def test_a_home_whose_name_is_not_utf_8_is_refused_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    home = tmp_path / os.fsdecode(b"h\xff")
    for there in (False, True):
        if there:
            home.mkdir()
        with pytest.raises(AppError) as caught:
            find_home(home)
        assert caught.value.code is LockFault.UNUSABLE
        status, err = command_line(["locate", "--home", str(home)], monkeypatch, capsys)
        assert status == 2
        assert err.startswith("rleex: ")
        assert "UTF-8" in err
        assert len(err.splitlines()) == 1


@pytest.mark.parametrize("path", HOMES, ids=" ".join)
def test_an_empty_home_is_not_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(AppError) as caught:
        call(path, "home", "")
    assert caught.value.code is CliFault.HOME_EMPTY
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("path", "name"), FLOATS)
@pytest.mark.parametrize("value", ["nan", "inf", "1e400"])
def test_a_number_that_is_none_is_refused(path: tuple[str, ...], name: str, value: str) -> None:
    with pytest.raises((AppError, typer.BadParameter)) as caught:
        call(path, name, value)
    if isinstance(caught.value, AppError):
        assert caught.value.code is CliFault.NOT_FINITE
        (option,) = [one.opts[0] for one in COMMANDS[path].params if one.name == name]
        assert caught.value.values["option"] == option


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("simulate", "corners", "--preflight"), "--preflight"),
        (("simulate", "corners", "--plot", "x.png"), "--plot"),
        (("simulate", "corners", "--profile", "tall"), "--profile"),
        (("simulate", "dropout", "--video", "x.mp4"), "--video"),
        (("simulate", "dropout", "--gait", "."), "--gait"),
        (("simulate", "fly"), "dropout"),
        (("audit", "show", "--since", "yesterday"), "--since yesterday"),
        (("audit", "show", "--until", "2026-11-21 09:30"), "--until 2026-11-21 09:30"),
        (("audit", "show", "--since", "2026-13-01"), "--since 2026-13-01"),
        (("audit", "show", "--until", "2026-02-29T10"), "--until 2026-02-29T10"),
        (("audit", "verify", "--copies", "no"), "no: No such file or directory"),
        (("configure", "language=xx"), "en, zh"),
        (("emulate-drives", "--fault", "silent@-1"), "silent@-1"),
        (("emulate-drives", "--fault", "silent@nan"), "silent@nan"),
        (("emulate-drives", "--fault", "late=inf"), "late=inf"),
        (("export", "x", "--to", "csv", "--output", "/proc/out"), "/proc/out can't be written"),
        (("evaluate", "outcomes", "--json", "/proc/self/comm"), "/proc/self/comm can't be written"),
        (("evaluate", "gestures", ".", "--png", "m.xyz"), "m.xyz is no figure's name"),
        (("evaluate", "trigger", "--plot", "m.xyz"), "m.xyz is no figure's name"),
        (("camera", "compare", "a", "b", "--plot", "m.xyz"), "m.xyz is no figure's name"),
        (("evaluate", "trigger", "--plot", "m.pgf"), "m.pgf is no figure's name"),
        (("simulate", "walk", "--plot", "m.xyz"), "m.xyz is no figure's name"),
        (("evaluate", "idle", "--progress", "file"), "file can't be read (JSON is malformed"),
        (("evaluate", "gestures", "--digital", "1", "--cross-validate"), "--cross-validate"),
        (("evaluate", "gestures", "--digital", "1", "--errors", "wrong"), "--errors"),
        (("evaluate", "gestures", "--digital", "1", "--keypoints", "k.npz"), "--keypoints"),
        (("evaluate", "gestures", ".", "--seed", "3"), "--seed"),
        (("evaluate", "preprocessing", "--every", "3"), "--every"),
        (("evaluate", "preprocessing", ".", "--digital", "3"), "--digital"),
        (("evaluate", "side", "--keypoints", "k.npz"), "--keypoints"),
        (("evaluate", "side", "--every", "10"), "--every"),
        (("evaluate", "side", ".", "--digital", "3"), "--digital"),
        (("evaluate", "side", ".", "--keypoints", "k.npz", "--every", "10"), "--every"),
        (("evaluate", "voice", ".", "--voices", "tuning"), "--voices"),
        (("evaluate", "voice", ".", "--minutes", "3"), "--minutes"),
        (("evaluate", "voice", ".", "--seed", "3"), "--seed"),
        (("evaluate", "voice", ".", "--keep", "kept"), "--keep"),
        (("evaluate", "distance", ".", "--hands", "3"), "--hands"),
        (("evaluate", "distance", ".", "--walks", "3"), "--walks"),
        (("evaluate", "distance", ".", "--focal-px", "900"), "--focal-px"),
        (("evaluate", "distance", ".", "--workers", "3"), "--workers"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_what_would_do_nothing_or_fail_later_is_refused_by_name(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    named: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("RLEEX_HOME", str(tmp_path / "home"))
    Path("file").write_text("no JSON")
    status, err = command_line([*arguments], monkeypatch, capsys)
    assert (status, len(err.splitlines())) == (2, 1), err
    assert named in err
    assert sorted(one.name for one in tmp_path.iterdir()) == ["file"]


def test_what_an_earlier_run_kept_is_refused_by_its_name(tmp_path: Path) -> None:
    (tmp_path / "kept").write_text("no JSON")
    with pytest.raises(AppError) as caught:
        kept_lines(tmp_path / "kept", dict)
    assert (caught.value.code, caught.value.values["file"]) == (EvaluateFault.FILE_UNREADABLE, tmp_path / "kept")


@pytest.mark.parametrize(("path", "name"), SEEDS)
def test_a_seed_below_0_is_refused(path: tuple[str, ...], name: str) -> None:
    with pytest.raises(typer.BadParameter):
        call(path, name, "-1")


@pytest.mark.parametrize(("path", "name"), SEEDS)
@pytest.mark.parametrize("value", [2**32, 10**30, 10**400])
def test_a_seed_beyond_32_bits_is_refused(path: tuple[str, ...], name: str, value: int) -> None:
    with pytest.raises(typer.BadParameter):
        call(path, name, str(value))


@pytest.mark.parametrize(
    "path", [path for path, one in COMMANDS.items() for x in one.params if x.name == "workers"], ids=" ".join
)
def test_more_processes_than_a_computer_carries_are_refused(path: tuple[str, ...]) -> None:
    with pytest.raises(typer.BadParameter):
        call(path, "workers", "65")


def test_every_json_file_is_tried_before_the_work() -> None:
    writers = {path for path, one in COMMANDS.items() for option in one.params if _writes_json(option)}
    assert len(writers) >= 10
    assert writers <= {path for path, name in OUTPUTS if name in {"json", "json_file"}}


def _writes_json(option: Any) -> bool:
    return "--json" in option.opts and not getattr(option, "is_flag", False)


def test_all_outputs_and_numbers_of_the_command_line_are_tried() -> None:
    assert len(OUTPUTS) >= 20
    assert len(FLOATS) >= 8
    assert len(SEEDS) >= 3
    assert len(HOMES) >= 40


@pytest.mark.parametrize(
    "sql",
    [
        "COPY records TO '{out}'",
        "COPY (SELECT 1) TO '{out}'",
        "ATTACH '{out}'",
        "EXPORT DATABASE '{out}'",
        "SELECT * FROM read_csv('/etc/passwd')",
        "SELECT * FROM read_text('/etc/passwd')",
        "SELECT * FROM read_blob('/etc/passwd')",
        "SELECT * FROM glob('/etc/*')",
        "SELECT * FROM '/etc/passwd'",
        "INSTALL httpfs",
        "LOAD httpfs",
        "PRAGMA database_list",
        "SET enable_external_access = true",
        "SET memory_limit = '100GB'",
        "CREATE TABLE a AS SELECT 1",
        "DROP TABLE records",
        "DELETE FROM records",
        "SELECT 1; DROP TABLE records",
        "CALL pragma_version()",
        "SELECT * FROM connection",
        "SELECT repeat('x', 10000000000)",
        "SELECT",
        "",
    ],
)
def test_a_query_only_selects_from_the_records(tmp_path: Path, sql: str) -> None:
    connection = connect_locked([SCHEMA1 / "logs"])
    with in_time(), pytest.raises(AuditError) as caught:
        ask(connection, sql.format(out=tmp_path / "out"))
    assert caught.value.code in (AuditFault.NOT_A_QUESTION, AuditFault.UNANSWERABLE)
    assert render(caught.value)
    assert not list(tmp_path.iterdir())
    assert ask(connection, "SELECT count(*) FROM records").num_rows == 1


ENDLESS = "WITH RECURSIVE a(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM a)"


@pytest.mark.parametrize(
    "sql",
    [
        "SELECT count(*) FROM range(10000000000000) a, range(1000) b",
        "SELECT * FROM range(10000000000), range(1000) b",
        f"{ENDLESS} SELECT count(*) FROM a",
        f"{ENDLESS} SELECT * FROM a",
        "SELECT list(range) FROM range(10000000000)",
        "SELECT range FROM range(10000000000) ORDER BY hash(range)",
    ],
)
def test_a_query_ends_in_time_and_within_its_size(sql: str) -> None:
    connection = connect_locked([SCHEMA1 / "logs"])
    with in_time(), pytest.raises(AuditError) as caught:
        ask(connection, sql, limit_s=0.3)
    assert caught.value.code in (AuditFault.QUESTION_TOO_LONG, AuditFault.ANSWER_TOO_LARGE, AuditFault.UNANSWERABLE)


def test_trails_that_do_not_fit_into_memory_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(records_table._LIMITS, "memory_limit", "1MB")
    with pytest.raises(AuditError) as caught:
        connect_locked([SCHEMA1 / "logs"])
    assert caught.value.code is AuditFault.TRAIL_UNREADABLE


def test_the_list_of_patients_prints_no_markup_and_no_escapes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "profiles"
    folder.mkdir()
    fields = b'sex = "male"\nstature_cm = 170\nmass_kg = 70\n'
    (folder / "a.toml").write_bytes(b'identifier = "a"\nnote = "[red]note[/x]"\n' + fields)
    (folder / "b\x1b[2J.toml").write_bytes(b'"\\u001b[2Jx" = 1\n')
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr(sys, "argv", ["rleex", "profile", "list", "--home", str(tmp_path)])
    with pytest.raises(SystemExit) as caught:
        main()
    assert not caught.value.code
    printed = capsys.readouterr().out
    assert "[red]note[/x]" in printed
    assert "\x1b[2J" not in printed


NAMED = "[red]a\x1b[2J"


@pytest.mark.parametrize("arguments", [("outcomes", "last"), ("recording", "info", NAMED + ".mcap")], ids=" ".join)
def test_tables_of_what_is_recorded_print_no_markup_and_no_escapes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_sample(tmp_path, minutes=0.1, patient=NAMED)
    RecordingWriter(Path(NAMED + ".mcap"), TOPICS, 0).finish()
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr(sys, "argv", ["rleex", *arguments, *(("--home", ".") if "outcomes" in arguments else ())])
    with pytest.raises(SystemExit) as caught:
        main()
    assert not caught.value.code
    printed = capsys.readouterr().out
    assert "[red]a" in printed
    assert "\x1b[2J" not in printed


@pytest.mark.parametrize(
    ("arguments", "option"),
    [
        (("run", "--serve", "--plain"), "--plain"),
        (("run", "--serve", "--patient", "p"), "--patient"),
        (("run", "--plain", "--camera", "webcam"), "--camera"),
        (("run", "--read-only", "--joints", "can"), "--joints"),
        (("audit", "show", "--all", "--follow"), "--follow"),
        (("audit", "show", "--all", "20261121"), "SESSION"),
    ],
)
def test_an_option_without_use_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], option: str
) -> None:
    status, err = command_line(list(arguments), monkeypatch, capsys)
    assert status == 2
    assert f"no use for {option}" in err
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ("profile", "import", "/dev/zero"),
        ("locate", "--home", "{file}"),
        ("demo", "--json", "no/x.json"),
        ("run",),
        ("run", "--read-only"),
    ],
)
def test_as_a_process_it_ends_with_one_sentence_and_status_2(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    (tmp_path / "file").touch()
    command = [sys.executable, "-c", "from app.cli import main; main()"]
    command += [part.format(file=tmp_path / "file") for part in arguments]
    environment = {**os.environ, "RLEEX_HOME": str(tmp_path / "home"), "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        command,
        capture_output=True,
        stdin=subprocess.DEVNULL,
        text=True,
        env=environment,
        timeout=60,
        check=False,
        cwd=tmp_path,
    )
    assert done.returncode == 2, done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "home").exists()
