"""A reason as it travels and as it is recorded: a code with its values, never a sentence.

The text is rendered where people read it (`app/text`), in their language. The key is `ClassName.MEMBER` of the Enum
that defines the code, and is the msgid in the catalogues: searching for it finds definition, use and wording.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum
from math import isfinite
from typing import Annotated, Union

from msgspec import Meta, Struct

Value = Union[int, float, str, "Reason", tuple["Reason", ...]]  # units stand in the values' names: `angle_rad`


class Reason(Struct, frozen=True):
    """A code and its values, SI units. A value that is itself a code (an action, a joint) is a Reason again."""

    code: str
    values: dict[str, Value] = {}


_MOST = 1 << 63
Render = Callable[[Reason], str]  # a reason as text for people; the catalogues are the application's


def reason(code: Enum, **values: object) -> Reason:
    """The reason with this code. Enum members, exceptions with a code, and sequences of them become reasons."""
    return Reason(key_of(code), {name: _value(value) for name, value in values.items()})


def reason_of(coded: object) -> Reason:
    """The code and values of what has both (errors of ours, explanations); any other error by its type and text."""
    code = getattr(coded, "code", None)
    if isinstance(code, Enum):
        return reason(code, **getattr(coded, "values", {}))
    return Reason("Error.UNEXPECTED", {"kind": type(coded).__name__, "text": str(coded)})


def key_of(code: Enum) -> str:
    """The catalogue's key of an Enum member."""
    return f"{type(code).__name__}.{code.name}"


def _fits(value: int | float | str) -> bool:
    """Whether JSON of ours can hold it: no NaN, no integer beyond 64 bits, which a tampered trail may claim."""
    if isinstance(value, float):
        return isfinite(value)
    return isinstance(value, str) or abs(value) < _MOST


def _value(value: object) -> Value:
    if isinstance(value, Reason):
        return value
    if isinstance(value, Enum):
        return Reason(key_of(value))
    if isinstance(value, BaseException) or isinstance(getattr(value, "code", None), Enum):
        return reason_of(value)
    if isinstance(value, int | float | str):
        return value if _fits(value) else str(value)
    if isinstance(value, Sequence):
        return tuple(each if isinstance(each, Reason) else Reason(key_of(each)) for each in value)
    return str(value)


def text_of(cause: Reason | str | None, render: Render) -> str:
    """A recorded reason as text, whichever version or hand wrote it: values that do not fit the wording are listed."""
    if not isinstance(cause, Reason):
        return cause or ""
    try:
        return render(cause).strip()
    except (KeyError, ValueError, TypeError, IndexError, AttributeError, RecursionError):
        return " ".join([cause.code, *(f"{name}={value}" for name, value in cause.values.items())])


_MOST_SHOWN = 10_000  # characters of one text; a person reads no more, a terminal chokes on it


def sanitize_terminal(text: str) -> str:
    """The text with every character that is not visible escaped as its code, and cut when it is too long.

    Not visible: control and format characters (bidirectional overrides among them), lone surrogates, private and
    unassigned ones, every separator but the space.
    """
    if len(text) > _MOST_SHOWN:
        text = f"{text[:_MOST_SHOWN]}… ({len(text)} characters)"
    if text.isprintable():
        return text
    return "".join(character if character.isprintable() else _escaped(character) for character in text)


def _escaped(character: str) -> str:
    code = ord(character)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


Measured = float | None  # null: not measured
Quad = tuple[Measured, Measured, Measured, Measured]  # left hip, left knee, right hip, right knee
Cause = Reason | str | None  # a code with values; text as schema 1 recorded it; null: none
Hex = Annotated[str, Meta(pattern="^[0-9a-f]*$")]
