"""Changes to a profile as people type them: `gait.step_length_cm=35`, in the names and units of the files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from profiles.errors import ProfileError
from profiles.files import from_table
from profiles.schema import Profile
from profiles.units import to_file

CLEARED = "none"  # typed to take an optional value away


def edit(profile: Profile, changes: Mapping[str, str]) -> Profile:
    """The profile with dotted file fields set to typed values. Raises ProfileError naming the field and its range."""
    table = to_file(profile)
    for field, typed in changes.items():
        _set(table, field, typed)
    return from_table(table, "The change")


def parse_assignments(typed: list[str]) -> dict[str, str]:
    """`field=value` words as a table. Raises ProfileError for a word that is none."""
    pairs = [word.partition("=") for word in typed]
    for word, (field, equals, _) in zip(typed, pairs, strict=True):
        if not (field and equals):
            raise ProfileError(f"{word!r} is no change: write field=value, such as gait.step_length_cm=35.")
    return {field.strip(): value.strip() for field, _, value in pairs}


def _set(table: dict[str, Any], field: str, typed: str) -> None:
    *groups, name = field.split(".")
    for group in groups:
        table = table.setdefault(group, {})
        if not isinstance(table, dict):
            raise ProfileError(f"There is no field {field}: {group} has no parts of its own.")
    if typed == CLEARED:
        table.pop(name, None)
    else:
        table[name] = _value(typed, table.get(name))


def _value(typed: str, now: Any) -> Any:
    """A number or truth value as TOML reads it, anything else as text; texts stay texts ("1.80" as a note)."""
    if isinstance(now, str):
        return typed
    try:
        value = tomlkit.parse(f"x = {typed}").unwrap()["x"]
    except TOMLKitError:
        return typed
    return value if isinstance(value, (bool, int, float)) else typed
