"""The keeping time: what is deleted when it is over, after which question, and what a wrong clock does not take."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.recording import schemas
from app.recording.expiry import expired
from app.recording.read import STAMP, RecordingReadFault
from app.recording.writer import RecordingWriter
from app.system.errors import AppError
from app.system.paths import Home, pictures_path, recording_path
from app.text.catalogue import tr
from logs.disk import Disk
from logs.journal import CHANGES, Moment
from logs.keys import load_or_make_key
from logs.manifest import Manifest
from logs.read import records
from logs.records import Change

NOW = datetime(2026, 11, 22, 10, tzinfo=UTC)
KEEP_DAYS = 30


def session(began: datetime, number: int = 1) -> str:
    return f"{began:{STAMP}}-{number:04x}"


def ago(days: float) -> str:
    return session(datetime.now(UTC) - timedelta(days=days))


@pytest.fixture
def home(tmp_path: Path) -> Home:
    """One with a keeping time."""
    place = Home(tmp_path / "home")
    place.logs.mkdir(parents=True)
    place.config.write_text(f"[recording]\nkeep_days = {KEEP_DAYS}\n", encoding="utf-8")
    return place


def with_files(*paths: Path) -> list[Path]:
    """Their content does not matter here."""
    for path in paths:
        path.write_bytes(b"12345")
    return list(paths)


def with_sessions(home: Home, *sessions: str) -> list[Path]:
    """Opened in this order, each with a recording."""
    moment = Moment(wall_ns=1, monotonic_ns=1)
    manifest = Manifest(home.logs, load_or_make_key(home.keys), Disk(), moment)
    for name in sessions:
        manifest.opened(f"{name}.jsonl", moment)
    assert manifest.settle()
    manifest.close()
    return with_files(*(recording_path(home.logs, name) for name in sessions))


def expire(home: Home, *options: str, answer: str = "") -> tuple[int, str]:
    done = CliRunner().invoke(cli, ["recording", "expire", "--home", str(home.root), *options], input=answer)
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.output


def test_the_keeping_time_takes_files_and_leaves_trails(home: Home) -> None:
    old, young = ago(31), ago(29)
    kept = with_files(recording_path(home.logs, young), home.logs / f"{old}.jsonl", home.logs / "mine.mcap")
    gone = with_files(recording_path(home.logs, old), pictures_path(home.logs, old))
    assert expire(home, "--yes")[0] == 0
    assert all(path.exists() for path in kept)
    assert not any(path.exists() for path in gone)
    (journal,) = (path for path in home.logs.parent.rglob(CHANGES) if path.is_file())
    changes = [one.body for one in records(journal) if isinstance(one.body, Change)]
    assert {(one.subject, one.name) for one in changes} == {("recording", path.name) for path in gone}
    code, text = expire(home)
    assert code == 0, "there is nothing to ask about"
    assert tr("recording.expired", count=0, days=KEEP_DAYS) in text


def test_without_a_keeping_time_nothing_is_deleted(home: Home) -> None:
    (path,) = with_files(recording_path(home.logs, ago(9999)))
    home.config.unlink()
    with pytest.raises(AppError) as caught:
        CliRunner().invoke(cli, ["recording", "expire", "--yes", "--home", str(home.root)], catch_exceptions=False)
    assert caught.value.code is RecordingReadFault.KEPT_FOR_EVER
    assert path.exists()


@pytest.mark.parametrize(("answer", "code"), [("y\n", 0), ("n\n", 1), ("\n", 1), ("", 1)])
def test_what_would_go_is_listed_with_its_age_and_asked_about(home: Home, answer: str, code: int) -> None:
    paths = with_files(recording_path(home.logs, ago(45.5)), pictures_path(home.logs, ago(45.5)))
    ended, text = expire(home, answer=answer)
    assert ended == code
    for path in paths:
        assert tr("recording.old", path=path, days=45) in text
        assert path.exists() is (code == 1)
    assert tr("recording.expire", count=2) in text
    assert bool(list(home.root.rglob(CHANGES))) is (code == 0)


def test_one_file_is_asked_about_and_told_of_as_one(home: Home) -> None:
    with_files(recording_path(home.logs, ago(45)))
    _, text = expire(home, answer="y\n")
    assert "Delete this file?" in text
    assert "1 file older than" in text


def test_what_a_running_session_writes_is_not_deleted(home: Home) -> None:
    name = ago(31)
    paths = [recording_path(home.logs, name), pictures_path(home.logs, name)]
    writers = [RecordingWriter(path, schemas.TOPICS, 0) for path in paths]
    refused = CliRunner().invoke(cli, ["recording", "delete-pictures", name, "--home", str(home.root)])
    code, text = expire(home, "--yes")
    assert (refused.exit_code, code) == (1, 0)
    for path in paths:
        assert path.exists()
        assert tr("recording.running", path=path) in text
    assert tr("recording.expired", count=0, days=KEEP_DAYS) in text
    assert not list(home.root.rglob(CHANGES)), "nothing is on record that did not happen"
    assert all(writer.finish() for writer in writers)
    assert expire(home, "--yes")[0] == 0
    assert not any(path.exists() for path in paths)


def test_a_recording_of_today_by_a_clock_that_was_set_back_stays_and_is_named(home: Home) -> None:
    before, today = ago(0.1), ago(9821.5)
    paths = with_sessions(home, before, today, ago(0))
    paths += with_files(pictures_path(home.logs, today))
    for options in ((), ("--yes",)):
        code, text = expire(home, *options)
        assert code == 0, "there is nothing to ask about"
        for path in (paths[1], paths[3]):
            assert tr("recording.misdated", path=path, days=9821, session=before) in text
        assert all(path.exists() for path in paths)


def test_a_recording_that_is_older_than_the_program_by_its_name_stays_and_is_named(home: Home) -> None:
    """Of a home's first session: no session before it tells that the clock was wrong."""
    paths = with_sessions(home, ago(9821.5), ago(0))
    code, text = expire(home, "--yes")
    assert code == 0
    assert tr("recording.too_old", path=paths[0], days=9821) in text
    assert all(path.exists() for path in paths)


DAYS_OLD = {"a": 90, "b": 60, "c": 40, "today": 0, "2000": 9821, "ahead": -3000}


@pytest.mark.parametrize(
    ("opened", "goes", "stays"),
    [
        ("a b c today", "a b c", {}),
        ("a 2000 2000 c today", "a c", {"2000": "a"}),
        ("a c b today", "a c", {"b": "c"}),
        ("a ahead b c today", "a b c", {}),  # what lies in the future makes nothing suspect
        ("today 2000 a b", "", {"2000": "today", "a": "today", "b": "today"}),
    ],
)
def test_a_session_is_misdated_where_one_before_it_has_a_later_name(
    home: Home, opened: str, goes: str, stays: dict[str, str]
) -> None:
    names = {key: session(NOW - timedelta(days=days)) for key, days in DAYS_OLD.items()}
    with_sessions(home, *(names[key] for key in opened.split()))
    found = expired(home.logs, KEEP_DAYS, NOW)
    assert [one.path.stem for one in found if not one.after] == [names[key] for key in goes.split()]
    assert {one.path.stem: one.after for one in found if one.after} == {
        names[key]: names[before] for key, before in stays.items()
    }
    assert {one.path.stem: one.age.days for one in found} == {
        names[key]: DAYS_OLD[key] for key in (*goes.split(), *stays)
    }


def test_what_no_manifest_names_goes_by_its_name_and_other_names_never(home: Home) -> None:
    (old,) = with_files(recording_path(home.logs, session(NOW - timedelta(days=31))))
    strange = ("20001399T000000Z-1.mcap", "20000101T00000Z-1.mcap", "20000101T000000Z.mcap", "x-20000101T000000Z.mcap")
    with_files(*(home.logs / name for name in strange))
    assert [one.path for one in expired(home.logs, KEEP_DAYS, NOW)] == [old]
    assert expired(home.logs, 31, NOW) == []
