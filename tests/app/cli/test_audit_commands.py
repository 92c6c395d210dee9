"""`rleex audit …` as a person or a script calls it."""

from __future__ import annotations

import json
import os
import threading
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

from app.cli import cli, main, tree
from app.system.errors import AppError
from app.text.catalogue import language, render, tr, use_language
from logs.disk import Disk
from logs.errors import AuditError, AuditFault
from logs.findings import Status
from logs.journal import CHANGES, append_signed
from logs.keys import load_or_make_key, load_public_key
from logs.line import wall_text
from logs.mirror import SUFFIX, CheckpointCopy, MirrorFault
from logs.read import follow, read
from logs.reason import key_of
from logs.records import Note, PatientChosen, Record
from logs.scan import Break
from logs.writer import SessionWriter
from tests.support.audit_trails import START, moment, write_session
from tests.support.disks import full_disk


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """A home with one session, its key beside it."""
    key = load_or_make_key(tmp_path / "keys")
    (tmp_path / "logs").mkdir()
    write_session(tmp_path / "logs", "s1", key, Disk())
    return tmp_path


def audit(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(cli, ["audit", *arguments])
    failed = isinstance(result.exception, AuditError | AppError)
    return result.exit_code, result.output + (render(result.exception) if result.exception and failed else "")


def test_verify_ends_with_0_1_or_2(home: Path) -> None:
    session = home / "logs" / "s1.jsonl"
    assert audit("verify", "--home", str(home))[0] == 0
    assert audit("verify", str(session))[0] == 0
    session.write_bytes(session.read_bytes().replace(b"Look.", b"Fine."))
    status, said = audit("verify", str(session), "--json", str(home / "findings.json"))
    assert (status, "line 5" in said) == (1, True)
    told = json.loads((home / "findings.json").read_text())
    assert (told["exit"], told["files"][0]["status"], told["files"][0]["line"]) == (1, "tampered", 5)
    assert told["files"][0]["code"] == key_of(Break.CHANGED)
    assert audit("verify", str(home / "nothing.jsonl"))[0] == 2
    assert audit("verify", "--home", str(home / "keys"))[0] == 2


def test_findings_name_a_file_whose_name_is_no_text(home: Path) -> None:
    (home / "logs" / os.fsdecode(b"\xff.jsonl")).write_bytes(b"{}\n")
    assert audit("verify", "--home", str(home), "--json", str(home / "findings.json"))[0] == 2
    named = [one["file"] for one in json.loads((home / "findings.json").read_text())["files"]]
    assert str(home / "logs" / r"\udcff.jsonl") in named


def test_show_says_when_nothing_passes_its_filters(home: Path) -> None:
    assert audit("show", "s1", "--home", str(home), "--since", "2026-11-21T09:30Z") == (
        0,
        tr("cli.audit.no_records") + "\n",
    )
    shown = audit("show", "s1", "--home", str(home))[1]
    assert tr("cli.audit.no_records") not in shown
    minute = next(read(home / "logs" / "s1.jsonl")).wall[:16]
    assert audit("show", "s1", "--home", str(home), "--since", f"{minute}Z")[1] == shown


def test_verify_takes_a_session_by_name_as_all_others_do(home: Path) -> None:
    for named in ("last", "s1", "s"):
        status, said = audit("verify", named, "--home", str(home))
        assert (status, "s1.jsonl" in said) == (0, True)
    assert "20990101" in audit("verify", "20990101", "--home", str(home))[1]


def test_verify_takes_the_key_that_is_given(home: Path, tmp_path: Path) -> None:
    exported = tmp_path / "exported.pub"
    assert audit("key", "--home", str(home), "-o", str(exported))[0] == 0
    assert load_public_key(exported) == load_public_key(home / "keys" / "console.pub")
    session = str(home / "logs" / "s1.jsonl")
    assert audit("verify", session, "--key", str(exported))[0] == 0
    load_or_make_key(tmp_path / "other")
    status, said = audit("verify", session, "--key", str(tmp_path / "other" / "console.pub"))
    assert (status, "not a known one" in said) == (1, True)
    (tmp_path / "junk.pub").write_text("junk")
    assert "no public key" in audit("verify", session, "--key", str(tmp_path / "junk.pub"))[1]


def test_a_report_is_written_and_a_place_that_refuses_is_named(home: Path) -> None:
    page = home / "report.html"
    assert audit("report", "last", "--home", str(home), "-o", str(page))[0] == 0
    assert page.read_text().startswith("<!doctype html>")
    assert "can't be written" in audit("report", "--home", str(home), "-o", str(home / "no" / "x.html"))[1]


def test_sessions_are_listed_and_shown(home: Path) -> None:
    assert "s1" in audit("list", "--home", str(home))[1]
    said = audit("show", "--home", str(home), "--kind", "stop")[1]
    assert said.count("\n") == 1
    assert "STOP in standing" in said


def test_an_unreadable_session_is_named_and_the_others_are_listed_and_shown(home: Path) -> None:
    write_session(home / "logs", "s3", load_or_make_key(home / "keys"), Disk())
    unreadable = home / "logs" / "s2.jsonl"
    unreadable.symlink_to("/proc/self/mem")  # a regular file that can't be read, by root either
    for arguments in (("list",), ("show", "--all")):
        result = CliRunner().invoke(cli, ["audit", *arguments, "--home", str(home)])
        assert (result.exit_code, result.stderr.count("\n")) == (0, 1)
        assert str(unreadable) in result.stderr
        assert "s1" in result.stdout
        assert "s3" in result.stdout


def test_a_list_on_a_narrow_terminal_has_the_whole_start(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    key = load_or_make_key(home / "keys")
    write_session(home / "logs", "20260921T141320Z-abcd", key, Disk(), (PatientChosen(patient="P-2026-017"),))
    monkeypatch.setattr("app.cli.audit.query.wide_console", lambda: Console(width=80))
    assert next(read(home / "logs" / "s1.jsonl")).wall[:16].replace("T", " ") in audit("list", "--home", str(home))[1]


def test_records_of_several_sessions_and_days_stand_under_their_names_and_days(home: Path) -> None:
    writer = SessionWriter(home / "logs", "s2", load_or_make_key(home / "keys"), Disk(), CheckpointCopy(""))
    writer.begin(START, moment(0))
    writer.take(moment(24 * 3600 * 100).entry(Note(text="after midnight")))
    writer.end("test", moment(24 * 3600 * 100))
    assert writer.finish(moment(24 * 3600 * 100))
    writer.close()
    days = [wall_text(moment(tick).wall_ns)[:10] for tick in (0, 24 * 3600 * 100)]
    said = audit("show", "--all", "--home", str(home))[1].splitlines()
    titles = [line for line in said if line.startswith(("s1", "s2", "20"))]
    assert titles == [f"s1  {days[0]}", f"s2  {days[0]}", days[1]]
    assert "after midnight" in said[said.index(days[1]) + 1]
    assert [line for line in audit("show", "s2", "--home", str(home))[1].splitlines() if line in days] == days[1:]
    assert audit("show", "--all", "--json", "--home", str(home))[1].count("\n") == len(said) - len(titles)


def test_a_disk_that_refuses_a_report_leaves_the_former_one(home: Path) -> None:
    page = home / "report.html"
    page.write_text("former")
    with full_disk(1000):
        assert "can't be written" in audit("report", "--home", str(home), "-o", str(page))[1]
    assert page.read_text() == "former"
    assert [path.name for path in home.iterdir() if "partial" in path.name] == []


def test_what_holds_no_record_has_neither_decisions_nor_a_report(home: Path) -> None:
    junk = home / "junk.jsonl"
    junk.write_text("no record\n")
    for arguments in (["replay", str(junk)], ["report", str(junk), "-o", str(home / "report.html")]):
        status, said = audit(*arguments)
        assert status != 0
        assert said.endswith(render(AuditError(AuditFault.TRAIL_EMPTY, path=junk)))
    assert not (home / "report.html").exists()


def test_lines_that_are_no_records_are_counted(home: Path) -> None:
    trail = home / "logs" / "s1.jsonl"
    parquet = str(home / "all.parquet")
    ask = ("query", "SELECT count(*) FROM records", "--at", str(trail))
    assert "no record" not in audit(*ask)[1] + audit("export", "--at", str(trail), "--parquet", parquet)[1]
    with trail.open("a") as file:
        file.write('torn {"body"\n{"kind": "none"}\n')
    told = tr("cli.audit.omitted", count=2, path=trail)
    assert told in audit(*ask)[1]
    assert told in audit("export", "--at", str(trail), "--parquet", parquet)[1]


def test_a_cut_journal_is_told_however_the_home_is_written(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    key = load_or_make_key(home / "keys")
    for text in ("one", "two"):
        append_signed(home / "logs" / CHANGES, "changes", [Note(text=text)], key, moment(0))
    changes = home / "logs" / CHANGES
    changes.write_bytes(b"".join(changes.read_bytes().splitlines(keepends=True)[:2]))
    link = home.parent / "link"
    link.symlink_to(home)
    monkeypatch.chdir(home.parent)
    for written in (str(home), home.name, f"./{home.name}", "link"):
        assert audit("verify", "--home", written)[0] == 1, written


def test_text_that_is_no_utf_8_is_refused_before_anything_is_written(home: Path) -> None:
    key = load_or_make_key(home / "keys")
    with pytest.raises(AuditError, match="NOT_UTF8"):
        append_signed(home / "logs" / CHANGES, "changes", [Note(text="\udcff")], key, moment(0))
    assert not (home / "logs" / CHANGES).exists()


def test_a_private_key_that_others_can_read_is_corrected_and_reported(home: Path) -> None:
    path = home / "keys" / "console.key"
    path.chmod(0o644)
    key = load_or_make_key(home / "keys")
    assert key.was_exposed
    assert path.stat().st_mode & 0o777 == 0o600
    assert not load_or_make_key(home / "keys").was_exposed


def test_a_new_key_leaves_the_old_public_one_behind(home: Path) -> None:
    (home / "keys" / "console.key").unlink()
    load_or_make_key(home / "keys")
    write_session(home / "logs", "s2", load_or_make_key(home / "keys"), Disk())
    assert audit("verify", str(home / "logs" / "s1.jsonl"))[0] == 0
    assert audit("verify", str(home / "logs" / "s2.jsonl"))[0] == 0


def test_checkpoints_reach_the_mirror_and_its_failure_is_reported(home: Path) -> None:
    key = load_or_make_key(home / "keys")
    copies = home / "copies"
    writer = SessionWriter(home / "logs", "s2", key, Disk(), CheckpointCopy(str(copies)))
    writer.begin(START, moment(0))
    writer.end("test", moment(1))
    assert writer.finish(moment(2))
    writer.close()
    assert (copies / f"s2.jsonl{SUFFIX}").read_bytes().count(b"\n") == 1
    assert audit("verify", "--home", str(home), "--copies", str(copies))[0] == 0
    (home / "blocked").touch()
    blocked = CheckpointCopy(str(home / "blocked" / "x"))
    blocked.put("s3.jsonl", b"line\n")
    blocked.close()
    assert blocked.fault is not None
    assert blocked.fault.code == key_of(MirrorFault.NOT_COPIED)


def test_following_gives_what_is_added_even_in_halves(tmp_path: Path, home: Path) -> None:
    lines = (home / "logs" / "s1.jsonl").read_bytes().splitlines(keepends=True)
    path = tmp_path / "growing.jsonl"
    path.write_bytes(lines[0] + lines[1][:20])
    over = threading.Event()
    handle = os.open(path, os.O_WRONLY | os.O_APPEND)
    found = follow(path, over.is_set, pause_s=0.001)
    assert isinstance(next(found), Record)
    os.write(handle, lines[1][20:] + lines[2])
    assert [isinstance(next(found), Record), isinstance(next(found), Record)] == [True, True]
    over.set()
    os.close(handle)
    assert list(found) == []


def test_a_stepped_clock_is_recorded(home: Path) -> None:
    key = load_or_make_key(home / "keys")
    writer = SessionWriter(home / "logs", "s3", key, Disk(), CheckpointCopy(""))
    writer.begin(START, moment(0))
    writer.take(moment(1).entry(Note(text="before")))
    late = moment(2)
    writer.take(type(late)(wall_ns=late.wall_ns + 5 * 10**9, monotonic_ns=late.monotonic_ns).entry(Note(text="after")))
    writer.settle(late.monotonic_ns)
    writer.close()
    assert "wall clock moved by +5.000 s" in audit("show", "s3", "--home", str(home))[1]


@pytest.mark.parametrize(
    "arguments",
    [
        ("--language", "zh", "audit", "verify"),
        ("audit", "verify", "--language=zh"),
        ("audit", "--language", "zh", "verify"),
    ],
)
def test_the_language_is_taken_wherever_it_stands(
    home: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...]
) -> None:
    monkeypatch.setattr("sys.argv", ["rleex", *arguments, "--home", str(home)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    assert language() == "zh"
    assert tr(Status.SOUND) in capsys.readouterr().out


def test_a_session_is_followed_in_the_language_asked_for(
    home: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["rleex", "--language", "zh", "run", "--plain", "--home", str(home)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert language() == "zh"
    assert "没有" in capsys.readouterr().err


def test_a_language_that_does_not_exist_is_refused(
    home: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["rleex", "audit", "list", "--language", "tlh", "--home", str(home)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert "tlh" in capsys.readouterr().err


def test_an_empty_language_takes_no_other_argument_away(
    home: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["rleex", "--language=", "audit", "list", "--home", str(home)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    assert "s1" in capsys.readouterr().out


def test_an_interrupt_before_the_command_runs_ends_it_in_silence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(tree, "import_module", interrupted)
    monkeypatch.setattr("sys.argv", ["rleex", "locate"])
    with pytest.raises((SystemExit, KeyboardInterrupt)) as ended:
        main()
    assert ended.value.args == (130,)
    assert capsys.readouterr() == ("", "")


def test_a_report_is_written_in_the_language_in_use(home: Path) -> None:
    use_language("zh")
    page = home / "report.html"
    assert audit("report", "last", "--home", str(home), "-o", str(page))[0] == 0
    assert '<html lang="zh">' in page.read_text()
    assert tr("report.timeline") in page.read_text()
