"""Changes of the configuration: by who may, on record before they are made; and those that an editor made."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from hashlib import sha256
from pathlib import Path
from typing import Any

import msgspec
import tomlkit

from app.system.authority import Authority, Proof, Subject
from app.system.config import Config, ConfigFault, load_config
from app.system.errors import AppError
from app.system.journals import append_to_journal
from app.system.operators import Permission, store_held
from app.system.paths import Home
from logs.journal import CHANGES, parts_of
from logs.read import records
from logs.reading.errors import cause_of
from logs.reading.formats import MAX_TOML, as_struct, parse_toml
from logs.reading.regular import read_text
from logs.reason import reason
from logs.records import Change
from profiles.fields import changed, flat
from profiles.files import CLEARED, replace_files, typed_value


class ConfigChange(Enum):
    """How the configuration changed."""

    BY_COMMAND = "by command"
    OUTSIDE = "outside"  # found at a session's start: an editor, or another program


_DIGEST = "sha256"  # field of a change: of the whole file


def change_config(by: Authority, typed: Mapping[str, str]) -> dict[str, tuple[Any, Any]]:
    """Set dotted fields, keeping the file's comments; what changed. Raises AppError, ProfileError, AuditError."""
    by.require(Permission.CONFIGURE)
    with store_held(by.home.keys):  # two at a time would each write the file without the other's change
        return _change(by, typed)


def record_outside_change(home: Home, operator: str, role: str, proof: Proof) -> None:
    """Put on record that the file is not as the last change on record left it. Raises AppError, AuditError.

    operator, role, proof: who starts a session, and how that is known.
    """
    path = home.config
    former, now = _recorded_digest(home.logs / CHANGES), _digest(_text(path))
    if now != former and (former is not None or path.exists()):
        change = Change(
            subject=Subject.CONFIGURATION.value,
            name=path.name,
            values={_DIGEST: (former, now)},
            reason=reason(ConfigChange.OUTSIDE),
            role=role,
            proof=proof.value,
        )
        append_to_journal(home, change, operator)


def _change(by: Authority, typed: Mapping[str, str]) -> dict[str, tuple[Any, Any]]:
    path = by.home.config
    before = flat(msgspec.to_builtins(load_config(path)))
    document = tomlkit.parse(_text(path))
    for field, value in typed.items():
        _set(document, field, value, before.get(field))
    text = tomlkit.dumps(document)
    try:
        after = flat(msgspec.to_builtins(as_struct(parse_toml(text), Config)))
    except OSError as error:
        raise AppError(ConfigFault.NOT_CHANGED, detail=cause_of(error)) from error
    changes = changed(before, after, before | after)
    if changes:
        recorded = changes | {_DIGEST: (_digest(_text(path)), _digest(text))}
        why = reason(ConfigChange.BY_COMMAND)
        by.change(Permission.CONFIGURE, Subject.CONFIGURATION, path.name, recorded, why)
        replace_files({path: text})
    return changes


def _recorded_digest(journal: Path) -> str | None:
    bodies = (record.body for part in reversed(parts_of(journal)) for record in reversed(records(part)))
    for body in bodies:
        if isinstance(body, Change) and body.subject == Subject.CONFIGURATION.value and _DIGEST in body.values:
            return str(body.values[_DIGEST][1])
    return None


def _set(document: Any, field: str, typed: str, now: Any) -> None:
    *groups, name = field.split(".")
    table = document
    for group in groups:
        table = table.setdefault(group, tomlkit.table())
        if not isinstance(table, dict):
            raise AppError(ConfigFault.NO_SUCH_FIELD, field=field)
    if typed == CLEARED:
        table.pop(name, None)
    else:
        table[name] = typed_value(typed, now)


def _text(path: Path) -> str:
    try:
        return read_text(path, MAX_TOML)
    except FileNotFoundError:
        return ""
    except OSError as error:
        raise AppError(ConfigFault.UNREADABLE, path=path, detail=cause_of(error)) from error


def _digest(text: str) -> str:
    return sha256(text.encode()).hexdigest()
