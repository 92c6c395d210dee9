"""TOML and JSON as values within limits: finite numbers of 64 bits, no NUL, nesting that nobody writes by hand."""

from __future__ import annotations

import datetime
import math
import tomllib
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from logs.reading.errors import InputError, InputFault
from logs.reading.regular import read_bytes, read_text

MAX_TOML = 256 << 10  # bytes; the longest that is shipped has a tenth
MAX_JSON_LINES = 64 << 20  # bytes
MAX_DEPTH = 16
_MAX_DOTS = 2500  # of a line: the parser's time grows with the square of a dotted key's parts
_INTEGERS = range(-(2**63), 2**63)

T = TypeVar("T")


def read_toml(path: Path, kind: type[T]) -> T:
    """A TOML file as a struct. Raises OSError, InputError."""
    return as_struct(parse_toml(read_text(path, MAX_TOML)), kind)


def as_struct(table: dict[str, Any], kind: type[T]) -> T:
    """A parsed TOML as a struct. Raises InputError naming the field."""
    try:
        dates = (datetime.datetime, datetime.date, datetime.time)
        return msgspec.convert(table, kind, builtin_types=dates, str_keys=True)
    except (msgspec.MsgspecError, ArithmeticError) as error:
        raise InputError(InputFault.MALFORMED, detail=str(error)) from error


def parse_toml(text: str) -> dict[str, Any]:
    """A TOML text as tables. Raises InputError."""
    if any(line.count(".") > _MAX_DOTS for line in text.splitlines()):
        raise InputError(InputFault.TOO_DEEP, limit=MAX_DEPTH)
    try:
        table = tomllib.loads(text)
    except RecursionError as error:
        raise InputError(InputFault.TOO_DEEP, limit=MAX_DEPTH) from error
    except ValueError as error:  # TOMLDecodeError among them; also an integer of thousands of digits
        raise InputError(InputFault.MALFORMED, detail=str(error)) from error
    check_values(table)
    return table


def decode_json(data: bytes, kind: type[T]) -> T:
    """JSON as a struct. Raises InputError."""
    try:
        return msgspec.json.decode(data, type=kind)
    except RecursionError as error:
        raise InputError(InputFault.TOO_DEEP, limit=MAX_DEPTH) from error
    except (msgspec.MsgspecError, ValueError, ArithmeticError) as error:
        raise InputError(InputFault.MALFORMED, detail=str(error)) from error


def read_json(path: Path, kind: type[T]) -> T:
    """A JSON file as a struct. Raises OSError, InputError."""
    return decode_json(read_bytes(path, 1 << 20), kind)


def read_json_lines(path: Path, kind: type[T]) -> tuple[T, ...]:
    """A struct a line, empty lines left out. Raises OSError, InputError."""
    return decode_json_lines(read_bytes(path, MAX_JSON_LINES), kind)


def decode_json_lines(data: bytes, kind: type[T]) -> tuple[T, ...]:
    """The same of bytes. Raises InputError."""
    return tuple(decode_json(line, kind) for line in data.split(b"\n") if line.strip())


def check_values(value: Any) -> None:
    """Raises InputError for a number beyond 64 bits or not finite, a NUL, and nesting beyond MAX_DEPTH."""
    waiting: list[tuple[Any, tuple[str, ...]]] = [(value, ())]
    while waiting:
        one, place = waiting.pop()
        if len(place) > MAX_DEPTH:
            raise InputError(InputFault.TOO_DEEP, limit=MAX_DEPTH)
        if isinstance(one, dict):
            waiting += [(held, (*place, str(key))) for key, held in one.items()]
            waiting += [(str(key), place) for key in one]
        elif isinstance(one, list):
            waiting += [(held, (*place, str(number))) for number, held in enumerate(one, start=1)]
        elif isinstance(one, str):
            if "\0" in one:
                raise InputError(InputFault.HAS_NUL, line=1)
        elif (isinstance(one, int) and one not in _INTEGERS) or (isinstance(one, float) and not math.isfinite(one)):
            raise InputError(InputFault.BAD_NUMBER, field=".".join(place))
