"""Where a recorded decision and the one made again are not the same."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any

import msgspec

from logs.records import Body, Record
from logs.show import kind_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """A field of a record. Values as in the file; None: nothing was recorded, or nothing is decided."""

    sequence: int
    kind: str
    field: str
    recorded: Any
    replayed: Any


def differences(record: Record, replayed: Body, *, without: Collection[str] = ()) -> Iterator[Difference]:
    """Every field in which a recorded body differs from the one made again; without: fields that are not replayed."""
    kind, other = kind_of(record.body), kind_of(replayed)
    if kind != other:
        yield Difference(sequence=record.sequence, kind=kind, field="kind", recorded=kind, replayed=other)
        return
    recorded_fields, replayed_fields = msgspec.to_builtins(record.body), msgspec.to_builtins(replayed)
    for name, value in replayed_fields.items():
        if name not in without and recorded_fields[name] != value:
            yield difference(record, name, recorded_fields[name], value)


def difference(record: Record, field: str, recorded: Any, replayed: Any) -> Difference:
    """One field of one record."""
    return Difference(
        sequence=record.sequence, kind=kind_of(record.body), field=field, recorded=recorded, replayed=replayed
    )
