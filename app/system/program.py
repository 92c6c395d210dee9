"""Which program and which rules a trail or a rehearsal's verdict comes from: hashes of files, and the version."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).parents[2]
VERSION, PROGRAM, RULES = "rleex", "program, SHA-256", "rules, SHA-256"  # names in a session's first record
_PROGRAM = ("app", "hal", "kgdfa", "logs", "profiles")
# What decides: gesture, distance, button, vote; requests, gait, events; plans; limits.
_RULES = ("kgdfa", "app/control", "app/motion", "app/perception", "app/ipc", "hal/joints")
_REHEARSED = ("app/motion", "hal")  # what plans, follows, guards and simulates
_SUFFIXES = {".py", ".npz", ".toml"}


@cache
def program_identity() -> dict[str, str]:
    """By name, for the trail and for comparing with one."""
    return {VERSION: version("rleex"), PROGRAM: _hash(_PROGRAM), RULES: _hash(_RULES)}


@cache
def rehearsal_identity() -> str:
    """Of the files that a rehearsal's verdict follows from, whether or not the version's number has changed."""
    return _hash(_REHEARSED)


def _hash(folders: Iterable[str]) -> str:
    """Of the files' names and contents, in order."""
    digest = sha256()
    paths = (path for folder in folders for path in (ROOT / folder).rglob("*") if path.suffix in _SUFFIXES)
    for path in sorted(paths):
        digest.update(f"{path.relative_to(ROOT).as_posix()}\0{sha256(path.read_bytes()).hexdigest()}\n".encode())
    return digest.hexdigest()
