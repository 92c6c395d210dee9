"""rleex recording: what a session's recording holds, and whether it is the one that its trail names."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.common import HomeOption, check_output, print_text, shown_after, wide_console
from app.cli.permission import sign_in
from app.system.errors import AppError
from app.system.operators import Permission
from app.system.paths import find_home, pictures_path
from app.text.catalogue import tr

if TYPE_CHECKING:
    from app.recording.read import HashCheck, Recording, SentCheck
    from app.system.authority import Authority
    from logs.records import RecordingFile

cli = typer.Typer(no_args_is_help=True)
FileArgument = Annotated[str, typer.Argument(help="A recording, or a session: name, beginning of a name, or last.")]


@cli.command()
def info(
    file: FileArgument = "last",
    json: Annotated[Path | None, typer.Option(callback=check_output, help="Write it here, too.")] = None,
    home: HomeOption = None,
) -> None:
    """Topics, counts, losses, and the hash against the trail."""
    from app.evaluate.harness import write_json
    from app.recording.encryption import key_of

    path = _found(file, home)
    found, proof, recorded, sent = _surveyed(path)
    key = key_of(path)

    def print_all() -> None:
        wide_console().print(_table(found, recorded, sent))
        _print_state(found, proof)
        print_text("recording.encrypted" if key else "recording.plain", fingerprint=key or "")

    values = {
        "file": path.name,
        "duration_s": found.duration_s,
        "messages": found.counts,
        "made": dict(sent.made),
        "lost": found.lost,
        "chunks": found.chunks,
        "whole": found.whole,
        "damage": found.damage,
        "source_damage": found.source_damage,
        "hash": proof.name.lower(),
        "key": key,
    }
    with shown_after(print_all):
        write_json(values, json)


@cli.command()
def verify(file: FileArgument = "last", home: HomeOption = None) -> None:
    """Prove that it is whole and the one that its trail names. Exit status: 0 sound, 1 not, 2 unreadable."""
    from app.recording.read import HashCheck

    found, proof, recorded, sent = _surveyed(_found(file, home))
    _print_state(found, proof)
    _print_sent(sent)
    counted = recorded is None or recorded.messages == dict(found.counts)
    if not counted:
        print_text("recording.miscounted")
    missing = sent.known and sent.missing
    raise typer.Exit(0 if found.complete and proof is HashCheck.SAME and counted and not missing else 1)


@cli.command("delete-pictures")
def delete_pictures(file: FileArgument, home: HomeOption = None) -> None:
    """Delete the camera's pictures of a session, for a patient who withdrew the consent; it is put on record.

    A therapist signs in first.
    """
    from app.recording.read import session_of

    by = sign_in(home, Permission.EDIT_PATIENTS)
    recording = _found(file, home)
    if not _delete(pictures_path(recording.parent, session_of(recording)), by):
        raise typer.Exit(1)


@cli.command()
def expire(
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask; for scripts.")] = False, home: HomeOption = None
) -> None:
    """Ask, then delete recordings and pictures older than recording.keep_days. Exit status: 0 done, 1 not agreed.

    A therapist signs in first.
    """
    from datetime import UTC, datetime

    from app.recording.expiry import expired
    from app.recording.read import RecordingReadFault
    from app.system.config import load_config

    by = sign_in(home, Permission.EDIT_PATIENTS)
    where = find_home(home)
    keep_days = load_config(where.config).recording.keep_days
    if keep_days is None:
        raise AppError(RecordingReadFault.KEPT_FOR_EVER)
    found = expired(where.logs, keep_days, datetime.now(UTC))
    for one in found:
        key = "recording.misdated" if one.after else "recording.too_old" if one.too_old else "recording.old"
        print_text(key, path=one.path, days=one.age.days, session=one.after)
    wanted = [one.path for one in found if not (one.after or one.too_old)]
    if wanted and not yes:
        typer.confirm(tr("recording.expire", count=len(wanted)), abort=True)
    deleted = [path for path in wanted if _delete(path, by)]
    print_text("recording.expired", count=len(deleted), days=keep_days)


def _delete(path: Path, by: Authority) -> bool:
    """A file of a recording, on record; first the record, so that no file goes without one.

    False: a running session writes it, would go on into a file without a name, and put its hash into the trail.
    """
    from app.recording.read import RecordingReadFault
    from app.system.authority import Subject
    from logs.disk import is_being_written
    from logs.reading.errors import cause_of

    try:
        if is_being_written(path):
            print_text("recording.running", path=path)
            return False
        size_bytes = path.stat().st_size
        by.change(Permission.EDIT_PATIENTS, Subject.RECORDING, path.name, {"size_bytes": (size_bytes, None)})
        path.unlink()
    except FileNotFoundError:
        raise AppError(RecordingReadFault.NO_PICTURES, path=path) from None
    except OSError as error:
        raise AppError(RecordingReadFault.UNDELETABLE, path=path, detail=cause_of(error)) from error
    print_text("recording.deleted", path=path)
    return True


@cli.command()
def schema() -> None:
    """Print every topic with its JSON Schema."""
    from app.recording.schemas import schemas_text

    typer.echo(schemas_text(), nl=False)


def _found(file: str, home: Path | None) -> Path:
    from app.recording.read import find_recording

    return find_recording(find_home(home).logs, file)


def _surveyed(path: Path) -> tuple[Recording, HashCheck, RecordingFile | None, SentCheck]:
    """What it holds, its hash against the trail, what the trail says of it, and what was sent to it."""
    from app.recording.read import check_sent, proof_of, survey

    found, (proof, recorded) = survey(path), proof_of(path)
    return found, proof, recorded, check_sent(found, recorded)


def _table(found: Recording, recorded: RecordingFile | None, sent: SentCheck) -> object:
    from rich.table import Table
    from rich.text import Text

    from logs.reason import sanitize_terminal

    table = Table(title=Text(sanitize_terminal(found.path.name), "table.title"))
    for heading in ("topic", "schema", "messages", "rate", "sent", "lost"):
        table.add_column(tr(f"recording.{heading}"), justify="left" if heading in {"topic", "schema"} else "right")
    lost = (recorded.lost if recorded is not None else None) or found.lost
    for topic, schema in found.schemas.items():
        count = found.counts[topic]
        rate = f"{count / found.duration_s:.1f} Hz" if found.duration_s else "–"
        texts = (Text(sanitize_terminal(text)) for text in (topic, schema))
        table.add_row(*texts, str(count), rate, str(sent.made.get(topic, "–")), str(lost.get(topic, 0)))
    return table


def _print_sent(sent: SentCheck) -> None:
    if not sent.known:
        print_text("recording.sent.unknown")
    elif sent.missing:
        print_text(
            "recording.sent.missing", topics=", ".join(f"{topic}: {sent.missing[topic]}" for topic in sent.missing)
        )
    else:
        print_text("recording.sent.all", messages=sum(sent.made.values()))


def _print_state(found: Recording, proof: HashCheck) -> None:
    state = "whole" if found.whole and not found.damage else "damaged" if found.damage else "cut"
    size_bytes = found.path.stat().st_size
    per_hour_mb = size_bytes / 1e6 / found.duration_s * 3600 if found.duration_s else 0.0
    print_text(f"recording.{state}", chunks=found.chunks, duration_s=found.duration_s, damage=found.damage)
    if found.source_damage:
        print_text("recording.source", damage=found.source_damage)
    print_text("recording.size", size_mb=size_bytes / 1e6, per_hour_mb=per_hour_mb)
    print_text(f"recording.hash.{proof.name.lower()}")
