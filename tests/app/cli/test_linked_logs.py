"""A logs folder that is a link to another disk: the home's keys judge its trails, not those beside the target."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.cli import cli
from logs.disk import Disk
from logs.errors import AuditError
from logs.journal import CHANGES, append_signed
from logs.keys import load_or_make_key
from logs.records import Note
from tests.app.cli.test_audit_commands import audit
from tests.support.audit_trails import moment, write_session


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The home of this user, with a session and a journal of two changes; its logs lie on `disk`."""
    home, logs = tmp_path / "home", tmp_path / "disk" / "logs"
    logs.mkdir(parents=True)
    key = load_or_make_key(home / "keys")
    (home / "logs").symlink_to(logs)
    write_session(home / "logs", "s1", key, Disk())
    for text in ("one", "two"):
        append_signed(home / "logs" / CHANGES, "changes", [Note(text=text)], key, moment(0))
    monkeypatch.setenv("RLEEX_HOME", str(home))
    return home


def refusal_of_query(*arguments: str) -> str:
    """Empty: it was answered."""
    result = CliRunner().invoke(cli, ["query", *arguments, "--ask", "sites"])
    assert result.exception is None or isinstance(result.exception, AuditError), result.exception
    return str(result.exception or "")


def test_untouched_trails_are_sound_however_they_are_named(home: Path) -> None:
    logs = home / "logs"
    for place in ((), ("--home", str(home)), (str(logs),), (str(logs.resolve()),), (str(logs / "s1.jsonl"),)):
        status, said = audit("verify", *place)
        assert status == 0, said
    assert not refusal_of_query()


def test_a_cut_journal_is_told(home: Path) -> None:
    changes = home / "logs" / CHANGES
    changes.write_bytes(b"".join(changes.read_bytes().splitlines(keepends=True)[:2]))
    for place in ((), ("--home", str(home)), (str(home / "logs"),), (str(changes),), (str(changes.resolve()),)):
        status, said = audit("verify", *place)
        assert status == 1, (place, said)
    assert CHANGES in refusal_of_query()
    assert CHANGES in refusal_of_query("--home", str(home))


def test_keys_that_lie_beside_the_target_do_not_count(home: Path, tmp_path: Path) -> None:
    for path in (tmp_path / "disk" / "logs").iterdir():
        path.unlink()
    forger = load_or_make_key(tmp_path / "disk" / "keys")
    session = write_session(home / "logs", "s1", forger, Disk())
    for place in ((), (str(session),), (str(session.resolve()),), (str(session.resolve().parent),), ("s1",)):
        status, said = audit("verify", *place)
        assert (status, "not a known one" in said) == (1, True), (place, said)
    page = tmp_path / "report.html"
    assert audit("report", "s1", "-o", str(page))[0] == 0
    assert "not a known one" in page.read_text()
    assert "KEY_NOT_KNOWN" in refusal_of_query()


def test_a_link_in_the_logs_folder_brings_no_keys_with_it(home: Path, tmp_path: Path) -> None:
    other = tmp_path / "other" / "logs"
    other.mkdir(parents=True)
    forged = write_session(other, "s2", load_or_make_key(tmp_path / "other" / "keys"), Disk())
    (home / "logs" / "s2.jsonl").symlink_to(forged)
    assert audit("verify", "s2")[0] == 1
    assert audit("verify", str(forged))[0] == 0, "named itself, it is another console's"


def test_another_home_is_judged_by_its_own_keys(home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load_or_make_key(tmp_path / "mine" / "keys")
    monkeypatch.setenv("RLEEX_HOME", str(tmp_path / "mine"))
    load_or_make_key(tmp_path / "disk" / "keys")
    monkeypatch.chdir(home)
    for place in (str(home / "logs"), "logs", "logs/s1.jsonl", str(home / "keys" / ".." / "logs")):
        status, said = audit("verify", place)
        assert status == 0, (place, said)
    assert not refusal_of_query(f"north={home}")
