"""Bad input at every reader and at the command line's doors: a coded refusal, in time, and nothing written."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import typer
from hypothesis import given, settings
from hypothesis import strategies as st

from app.cli import USER_ERRORS, main
from app.cli.common import CliFault
from app.cli.tree import tree
from app.console.review_data import open_session
from app.console.session_index import SessionRecords
from app.evaluate.gestures.images import load_hands
from app.evaluate.loop.rehearsal import read_norm
from app.evaluate.readings import read_footage, read_frames, read_labels
from app.system.config import load_config
from app.system.errors import AppError
from app.system.operators import load_store
from app.text.catalogue import render, use_language
from hal.cameras.factory import open_camera
from hal.cameras.intrinsics import assumed
from hal.cameras.intrinsics import load as load_intrinsics
from hal.cameras.intrinsics import save as save_intrinsics
from hal.cameras.playback import read_image
from hal.joints.can.candump import open_log
from hal.joints.device import DEFAULT_DEVICE, load_exoskeleton
from hal.joints.motors import BUILT_IN_TABLE, load_motors
from kgdfa.robust import load_model
from logs.errors import AuditError, AuditFault
from logs.keys import load_public_key, read_anchors
from logs.query import ask, connect_locked
from logs.read import records
from logs.reading.errors import InputError, InputFault
from logs.reading.formats import MAX_TOML, parse_json, parse_toml, read_json_lines
from logs.reading.regular import read_bytes
from profiles.files import decode, encode, read_text
from profiles.schema import DEMO_PATIENT
from profiles.store import ProfileStore

LIMIT_S = 20
ROOT = Path(__file__).parents[1]
SCHEMA1 = ROOT / "tests/logs/data/schema1"


@contextmanager
def in_time(limit_s: int = LIMIT_S) -> Iterator[None]:
    """Fail instead of hanging."""

    def late(*_: object) -> None:
        pytest.fail(f"longer than {limit_s} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(limit_s)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def _history(path: Path) -> object:
    return ProfileStore(path.parent.parent).history("x")


# Reader → (the name its file has, what opens it).
READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "configuration": ("config.toml", load_config),
    "device": ("device.toml", load_exoskeleton),
    "motors": ("motors.toml", load_motors.__wrapped__),
    "intrinsics": ("cameras.toml", lambda path: load_intrinsics(path, "camera")),
    "profile": ("x.toml", lambda path: decode(read_text(path), str(path))),
    "profile history": ("history/x.jsonl", _history),
    "operators": ("operators.json", lambda path: load_store(path.parent)),
    "anchor": ("history.json", lambda path: read_anchors(path.parent)),
    "journal's end": ("ends/changes.jsonl.json", lambda path: read_anchors(path.parent.parent)),
    "public key": ("console.pub", load_public_key),
    "session index": ("x.jsonl", lambda path: SessionRecords(path.parent).of("x")),
    "trail": ("trail.jsonl", records),
    "review": ("trail.jsonl", open_session),
    "query": ("trail.jsonl", lambda path: connect_locked([path])),
    "labels": ("labels.csv", lambda path: read_labels(path.parent)),
    "frames": ("frames.csv", read_frames),
    "gait norm": ("gait_norm.csv", lambda path: read_norm(path.parent)),
    "footage": ("film.mp4", read_footage),
    "video": ("film.mp4", lambda path: open_camera("recording", device=str(path)).open()),
    "recording": ("frames.jsonl", lambda path: open_camera("recording", device=str(path.parent)).open()),
    "image": ("a.png", read_image),
    "keypoints": ("hands.npz", lambda path: load_hands(path, [])),
    "gesture model": ("robust.npz", load_model),
    "bus log": ("bus.log", lambda path: open_log(path).close()),
}
# Readers that judge line by line what they hold: a bad line is shown as one or left out, not refused.
TOLERANT = {"trail", "review", "query", "bus log"}

CONTENTS: dict[str, bytes] = {
    "UTF-16": 'language = "en"\n'.encode("utf-16"),
    "Latin-1": b'language = "\xe9\xff"\n',
    "NUL": b"a = 1\0\n",
    "escaped NUL": b'model = "a\\u0000b"\n',
    "integer of 400 digits": b"idle_lock_s = " + b"9" * 400 + b"\n",
    "integer of 5000 digits": b"stature_cm = " + b"9" * 5000 + b"\n",
    "inf": b"idle_lock_s = inf\n",
    "nan": b"idle_lock_s = nan\n",
    "1e400": b"idle_lock_s = 1e400\n",
    "nested TOML": b"a = " + b"[" * 50_000 + b"]" * 50_000,
    "nested tables": b"a = " + b"{b = " * 5_000 + b"1" + b"}" * 5_000,
    "dotted key": b".".join([b"a"] * 60_000) + b" = 1\n",
    "nested JSON": b"[" * 200_000,
    "nested objects": b'{"a":' * 100_000,
    "JSON 1e400": b'{"format": "rleex-recording", "version": 1e400}\n',
    "JSON NaN": b'{"captured_ns": NaN}\n',
    "zeros": bytes(100_000),
    "escapes": b"\x1b[2J\x1b]0;x\x07 = 1\n",
    "half a PNG": b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR\xff\xff\xff\xff\xff\xff\xff\xff",
    "zip of nothing": b"PK\x05\x06" + bytes(18),
}
NODES: dict[str, Callable[[Path], object]] = {
    "folder": lambda path: path.mkdir(),
    "pipe": os.mkfifo,
    "endless device": lambda path: path.symlink_to("/dev/zero"),
    "random device": lambda path: path.symlink_to("/dev/urandom"),
    "terminal": lambda path: path.symlink_to("/dev/tty"),
    "itself": lambda path: path.symlink_to(path.name),
}


def worded(error: Exception) -> Exception:
    """The error, which has text in both languages."""
    for language in ("zh", "en"):
        use_language(language)
        assert render(error)
    return error


def opened(path: Path, read: Callable[[Path], object]) -> Exception | None:
    """The refusal of a reader, worded in both languages; None when it took the file. All else fails the test."""
    before = sorted(path.parent.rglob("*"))
    with in_time():
        try:
            read(path)
        except (*USER_ERRORS, InputError) as error:
            return worded(error)
        finally:
            assert sorted(path.parent.rglob("*")) == before
    return None


def place(folder: Path, name: str) -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


@pytest.mark.parametrize("content", CONTENTS)
@pytest.mark.parametrize("reader", READERS)
def test_bad_content_is_refused(tmp_path: Path, reader: str, content: str) -> None:
    name, read = READERS[reader]
    path = place(tmp_path, name)
    path.write_bytes(CONTENTS[content])
    assert opened(path, read) is not None or reader in TOLERANT


# A link to itself does not exist for what may be missing; the others are refused as what they are.
@pytest.mark.parametrize("node", NODES)
@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_regular_file_is_refused(tmp_path: Path, reader: str, node: str) -> None:
    name, read = READERS[reader]
    path = place(tmp_path, name)
    NODES[node](path)
    assert opened(path, read) is not None or node == "itself"


def _valid(folder: Path) -> dict[str, bytes]:
    """A valid file of most kinds."""
    save_intrinsics(folder / "cameras.toml", "camera", assumed(1280, 720), 0.2)
    return {
        "configuration": b'language = "zh"\n[camera]\nkind = "webcam"\nrate_hz = 30.0\n[keys]\nstop = "s"\n',
        "device": DEFAULT_DEVICE.read_bytes(),
        "motors": BUILT_IN_TABLE.read_bytes(),
        "intrinsics": (folder / "cameras.toml").read_bytes(),
        "profile": encode(DEMO_PATIENT).encode(),
        "profile history": b'{"at":"2026","by":"x","changes":{"a":[1,2.5]},"why":""}\n',
        "session index": b'{"session":"a","patient":"x","at":"2026","steps":3}\n',
        "trail": (SCHEMA1 / "logs/whole.jsonl").read_bytes()[:20_000],
        "review": (SCHEMA1 / "logs/whole.jsonl").read_bytes()[:20_000],
        "public key": (SCHEMA1 / "keys/console.pub").read_bytes(),
        "anchor": (SCHEMA1 / "keys/history.json").read_bytes(),
        "labels": b"path,label,source,group\na.jpg,1,s,g\n",
        "frames": b"path,label,fx,anchor_cm\na.jpg,1,900,6.7\n",
        "gesture model": (ROOT / "kgdfa/robust.npz").read_bytes(),
    }


@pytest.mark.parametrize("reader", sorted(READERS))
@given(data=st.data())
@settings(max_examples=25)
def test_random_and_mutated_files_end_in_a_code(
    tmp_path_factory: pytest.TempPathFactory, reader: str, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("mutated")
    try:
        content = _valid(folder).get(reader, b"")
        (folder / "cameras.toml").unlink()
        if content and data.draw(st.booleans()):
            at = data.draw(st.integers(0, len(content)))
            gone = data.draw(st.integers(0, 40))
            content = content[:at] + data.draw(st.binary(max_size=20)) + content[at + gone :]
        else:
            content = data.draw(st.binary(max_size=300))
        name, read = READERS[reader]
        path = place(folder, name)
        path.write_bytes(content)
        opened(path, read)
    finally:
        shutil.rmtree(folder)


@given(st.text(max_size=200))
def test_any_text_as_toml_or_json_ends_in_a_code(text: str) -> None:
    for parse in (parse_toml, lambda one: parse_json(one.encode("utf-8", "surrogatepass"))):
        try:
            parse(text)
        except InputError as error:
            worded(error)


def test_sizes_are_limited_and_a_byte_order_mark_is_none_of_the_text(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_bytes(b"#" * (MAX_TOML + 1))
    with pytest.raises(AppError) as caught:
        load_config(path)
    detail = caught.value.values["detail"]
    assert isinstance(detail, InputError)
    assert detail.code is InputFault.TOO_LARGE
    path.write_bytes(b'\xef\xbb\xbflanguage = "zh"\r\n')
    assert load_config(path).language == "zh"
    with pytest.raises(InputError):
        read_bytes(Path("/proc/self/maps"), 10)  # a regular file that says it has no size
    path.write_bytes(b"{}\n\n[]\n")
    assert read_json_lines(path, object) == ({}, [])


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


def call(path: tuple[str, ...], name: str, value: str) -> None:
    """A command with one option given, and anything for the arguments and options that it must have."""
    arguments: list[str] = []
    for parameter in COMMANDS[path].params:
        if parameter.name == name:
            arguments += [parameter.opts[0], value] if parameter.param_type_name == "option" else [value]
        elif parameter.required:
            some = "1" if parameter.bare_type() == "float" else "x"
            arguments += [parameter.opts[0], some] if parameter.param_type_name == "option" else [some]
    with in_time():
        COMMANDS[path].main(arguments, standalone_mode=False)


@pytest.mark.parametrize(("path", "name"), OUTPUTS)
@pytest.mark.parametrize("place", ["file/x", "no/x", "folder"])
def test_an_output_that_can_not_be_written_is_refused_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: tuple[str, ...], name: str, place: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    Path("folder").mkdir()
    if name == "errors" and place != "file/x":
        pytest.skip("a folder that is made")
    with pytest.raises(AppError) as caught:
        call(path, name, place)
    assert caught.value.code is CliFault.OUTPUT_UNWRITABLE
    assert sorted(one.name for one in tmp_path.rglob("*")) == ["file", "folder"]


@pytest.mark.parametrize(("path", "name"), FLOATS)
@pytest.mark.parametrize("value", ["nan", "inf", "1e400"])
def test_a_number_that_is_none_is_refused(path: tuple[str, ...], name: str, value: str) -> None:
    with pytest.raises((AppError, typer.BadParameter)) as caught:
        call(path, name, value)
    if isinstance(caught.value, AppError):
        assert caught.value.code is CliFault.NOT_FINITE


@pytest.mark.parametrize(("path", "name"), SEEDS)
def test_a_seed_below_0_is_refused(path: tuple[str, ...], name: str) -> None:
    with pytest.raises(typer.BadParameter):
        call(path, name, "-1")


def test_all_outputs_and_numbers_of_the_command_line_are_tried() -> None:
    assert len(OUTPUTS) >= 20
    assert len(FLOATS) >= 8
    assert len(SEEDS) >= 3


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


@pytest.mark.parametrize("sql", ["SELECT count(*) FROM range(10000000000000) a", "SELECT * FROM range(10000000000)"])
def test_a_query_ends_in_time_and_within_its_size(sql: str) -> None:
    connection = connect_locked([SCHEMA1 / "logs"])
    with in_time(), pytest.raises(AuditError) as caught:
        ask(connection, f"{sql}, range(1000) b", limit_s=0.5)
    assert caught.value.code in (AuditFault.QUESTION_TOO_LONG, AuditFault.ANSWER_TOO_LARGE)


def test_the_list_of_patients_prints_no_markup_and_no_escapes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = place(tmp_path, "profiles/x").parent
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


@pytest.mark.parametrize(
    "arguments", [("profile", "import", "/dev/zero"), ("locate", "--home", "{file}"), ("demo", "--json", "no/x.json")]
)
def test_as_a_process_it_ends_with_one_sentence_and_status_2(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    (tmp_path / "file").touch()
    command = [sys.executable, "-c", "from app.cli import main; main()"]
    command += [part.format(file=tmp_path / "file") for part in arguments]
    environment = {**os.environ, "RLEEX_HOME": str(tmp_path / "home"), "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        command, capture_output=True, text=True, env=environment, timeout=60, check=False, cwd=tmp_path
    )
    assert done.returncode == 2, done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "home").exists()
