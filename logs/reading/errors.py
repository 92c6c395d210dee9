"""What every package's errors are, and what the readers refuse: codes with values; the catalogues hold the wording."""

from __future__ import annotations

import errno
from enum import Enum
from functools import partial

import msgspec

# What msgspec raises for bytes from outside: also text that is no UTF-8, and nesting beyond the interpreter's limit.
UNDECODABLE = (msgspec.MsgspecError, UnicodeDecodeError, RecursionError)


class _BaseError(Exception):
    """A code and its values. `str()` is for engineers; users read the rendered code."""

    code: Enum
    values: dict[str, object]

    def __reduce__(self) -> tuple[object, ...]:
        """An exception's own hands on what `super().__init__` got: a worker process could not return a refusal."""
        return partial(type(self), self.code, **self.values), ()

    def __str__(self) -> str:
        return " ".join([self.code.name, *(f"{name}={value}" for name, value in self.values.items())])


class CodedError(_BaseError):
    """A refusal: a code and its values."""

    def __init__(self, code: Enum, **values: object) -> None:
        super().__init__(code.name, values)
        self.code, self.values = code, values


class InputFault(Enum):
    """Why a file from outside can't be taken. Its value is for engineers; the values of each stand beside it."""

    NOT_REGULAR = "no regular file"
    TOO_LARGE = "too large"  # limit_bytes
    NOT_UTF8 = "not UTF-8"  # byte
    HAS_NUL = "NUL in text"  # line
    BAD_NUMBER = "number not finite or beyond 64 bits"  # field
    TOO_DEEP = "nested too deeply"  # limit
    MALFORMED = "malformed"  # detail: the parser's message


class InputError(_BaseError, OSError):
    """A file that is refused: a code and its values. An OSError, so that who expects one of a file expects this."""

    def __init__(self, code: InputFault, **values: object) -> None:
        super().__init__(errno.EINVAL, code.value)
        self.code, self.values = code, values


def cause_of(error: Exception) -> object:
    """An error as a value of another: a refusal with its code, the system's without number and path."""
    if isinstance(error, InputError):
        return error
    return (isinstance(error, OSError) and error.strerror) or str(error)
