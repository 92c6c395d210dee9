"""A profile as TOML text, and files that are either the old or the new one, never half of either."""

from __future__ import annotations

import math
import os
import re
import tomllib
from collections.abc import Mapping, MutableMapping
from pathlib import Path
from typing import Any

import msgspec
import tomlkit
from tomlkit.exceptions import TOMLKitError

import logs.reading.regular
from logs.reading.errors import InputError, cause_of
from logs.reading.formats import MAX_TOML, parse_toml
from profiles.errors import ProfileError, ProfileFault
from profiles.fields import check, file_key, from_file, to_file
from profiles.schema import Profile

HEADING = "Patient profile: centimetres, degrees, kilograms, seconds. Comments are kept."


def decode(text: str, where: str) -> Profile:
    """The profile in a TOML text. Raises ProfileError naming the place and the field or line."""
    try:
        table = parse_toml(text)
    except InputError as error:
        raise _in_file(where, ProfileError(ProfileFault.TOML, detail=cause_of(error))) from error
    return from_table(table, where)


def from_table(table: Mapping[str, Any], where: str) -> Profile:
    """The profile in a table as files have it. Raises ProfileError naming place (if any) and field."""
    try:
        return check(msgspec.convert(from_file(table, Profile), type=Profile))
    except (msgspec.ValidationError, ArithmeticError) as error:
        fault = ProfileError(ProfileFault.FIELD_TYPE, detail=_in_file_terms(str(error)))
        raise _in_file(where, fault) from error
    except ProfileError as error:
        raise _in_file(where, error) from error


def _in_file(place: str, fault: ProfileError) -> ProfileError:
    return ProfileError(ProfileFault.IN_FILE, place=place, fault=fault) if place else fault


def encode(profile: Profile, existing: str = "") -> str:
    """TOML text of a profile; comments and order of an existing text survive."""
    document = _document(existing)
    if not existing:
        document.add(tomlkit.comment(HEADING))
    wanted = to_file(profile)
    _merge(document, {**{k: v for k, v in wanted.items() if not isinstance(v, (list, Mapping))}, **wanted})
    return tomlkit.dumps(document)


def _document(existing: str) -> tomlkit.TOMLDocument:
    """The text with its comments. What the strict parser took and this one can't gets a document without them."""
    try:
        return tomlkit.parse(existing)
    except (TOMLKitError, ValueError, RecursionError):
        return tomlkit.document()


def read_text(path: Path, limit: int = MAX_TOML) -> str:
    """A file's text. Raises ProfileError when it can't be read or can't be a profile."""
    try:
        return logs.reading.regular.read_text(path, limit)
    except OSError as error:
        raise ProfileError(ProfileFault.UNREADABLE, path=path, detail=cause_of(error)) from error


def replace_files(contents: Mapping[Path, str]) -> None:
    """Write every file whole and to the disk, then rename them into place in their order.

    The old ones stand untouched unless all new ones are on the disk. A rename that fails then leaves those before it
    in place: a caller puts the record of a change before the changed file.
    Raises ProfileError when the disk is full or the folder can't be written.
    """
    waiting: list[tuple[Path, Path]] = []
    try:
        for path, text in contents.items():
            path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            new = path.with_name(f".{path.name}.new")
            waiting.append((new, path))
            _write_through(new, text)
        for new, path in waiting:
            new.replace(path)
        for folder in {path.parent for path in contents}:
            _sync_folder(folder)
    except OSError as error:
        for new, _ in waiting:
            new.unlink(missing_ok=True)
        names = ", ".join(str(path) for path in contents)
        raise ProfileError(ProfileFault.NOT_SAVED, paths=names, detail=error.strerror) from error


def _write_through(path: Path, text: str) -> None:
    with path.open("w", encoding="utf-8") as file:
        path.chmod(0o600)
        file.write(text)
        file.flush()
        os.fsync(file.fileno())


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _merge(target: MutableMapping[str, Any], wanted: Mapping[str, Any]) -> None:
    """Bring the document to the wanted values, touching only what differs."""
    for key in [key for key in target if key not in wanted]:
        del target[key]
    for key, value in wanted.items():
        held = target.get(key)
        if isinstance(value, Mapping) and isinstance(held, MutableMapping):
            _merge(held, value)
        elif held != value:
            if isinstance(
                value, list
            ):  # tables belong behind every plain value, or they would swallow those after them
                target.pop(key, None)
            target[key] = value


def _in_file_terms(message: str) -> str:
    """msgspec names the SI field as `$.gait.step_length_m`; people know it as gait.step_length_cm."""

    def as_key(match: re.Match[str]) -> str:
        return file_key(re.sub(r"\[[^]]*\]", "", match.group(1)))[0]

    return re.sub(r"field `(\w+)`", lambda match: f"field {as_key(match)}", re.sub(r"`\$\.?([^`]*)`", as_key, message))


CLEARED = "none"  # typed to take an optional value away


def edit(profile: Profile, changes: Mapping[str, str]) -> Profile:
    """The profile with dotted file fields set to typed values, its identifier not among them.

    Raises ProfileError naming the field and its range.
    """
    table = to_file(profile)
    for field, typed in changes.items():
        _set(table, field, typed)
    edited = from_table(table, "")
    if edited.identifier != profile.identifier:
        raise ProfileError(ProfileFault.IDENTIFIER_FIXED)
    return edited


def parse_assignments(typed: list[str]) -> dict[str, str]:
    """`field=value` words as a table. Raises ProfileError for a word that is none."""
    pairs = [word.partition("=") for word in typed]
    for word, (field, equals, _) in zip(typed, pairs, strict=True):
        if not (field and equals):
            raise ProfileError(ProfileFault.NO_ASSIGNMENT, typed=word)
    return {field.strip(): value.strip() for field, _, value in pairs}


def _set(table: dict[str, Any], field: str, typed: str) -> None:
    *groups, name = field.split(".")
    for group in groups:
        table = table.setdefault(group, {})
        if not isinstance(table, dict):
            raise ProfileError(ProfileFault.NO_GROUP, field=field, group=group)
    if typed == CLEARED:
        table.pop(name, None)
    else:
        table[name] = typed_value(typed, table.get(name))


def typed_value(typed: str, now: Any) -> Any:
    """A number or truth value as TOML reads it, anything else as text; texts stay texts ("1.80" as a note)."""
    if isinstance(now, str):
        return typed
    try:
        value = tomllib.loads(f"x = {typed}")["x"]
    except (ValueError, RecursionError):
        return typed
    if isinstance(value, int) and abs(value) >= 2**63:
        return math.copysign(math.inf, value > 0 or -1)  # out of every range
    return value if isinstance(value, (bool, int, float)) else typed
