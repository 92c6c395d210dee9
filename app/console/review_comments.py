"""Reviewers' comments: signed records in a file beside the session, which itself is never touched."""

from __future__ import annotations

from pathlib import Path

from app.system.paths import Home
from logs.journal import COMMENTS, append_signed
from logs.keys import load_or_make_key
from logs.manifest import Moment
from logs.read import records
from logs.records import Comment, Record


def comments_path(session: Path) -> Path:
    """Where the comments on a session are kept."""
    return session.with_name(session.stem + COMMENTS)


def comments_on(session: Path) -> dict[int, list[Comment]]:
    """The comments on a session by the record that they are about. Raises AuditError when they can't be read."""
    path = comments_path(session)
    found: dict[int, list[Comment]] = {}
    for record in records(path) if path.exists() else []:
        if isinstance(record.body, Comment):
            found.setdefault(record.body.about_sequence, []).append(record.body)
    return found


def write_comment(home: Home, session: Path, about: Record, text: str, now: Moment) -> None:
    """Sign a comment with the console's key and keep it. Raises AuditError when the disk refuses."""
    key = load_or_make_key(home.keys)
    comment = Comment(about_sequence=about.sequence, about_hash=about.hash, text=text, key=key.public.fingerprint)
    append_signed(comments_path(session), f"comments {about.session}", [comment], key, now)
