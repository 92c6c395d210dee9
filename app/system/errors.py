"""What the application refuses, as a code with values; the wording is in the catalogues (`app/text`)."""

from __future__ import annotations

from enum import Enum


class ConsoleFault(Enum):
    """What the console refuses."""

    NO_SESSION_TO_WATCH = "no session to watch"
    SESSION_ENDED = "session ended"
    NO_SESSION = "no session"
    UNKNOWN_KEY_NAME = "unknown key name"
    KEY_TAKEN = "key taken"


class AppError(Exception):
    """A configuration, process or session that can't go on. `str()` is for engineers, `render()` for users."""

    def __init__(self, code: Enum, **values: object) -> None:
        super().__init__(code, values)
        self.code = code
        self.values = values

    def __str__(self) -> str:
        return " ".join([str(self.code), *(f"{name}={value}" for name, value in self.values.items())])
