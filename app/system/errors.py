"""What the application refuses, as a code with values; the wording is in the catalogues (`app/text`)."""

from __future__ import annotations

from enum import Enum

from logs.reading.errors import CodedError


class ConsoleFault(Enum):
    """What the console refuses."""

    NO_SESSION_TO_WATCH = "no session to watch"
    SESSION_ENDED = "session ended"
    NO_SESSION = "no session"
    UNKNOWN_KEY_NAME = "unknown key name"
    NO_SUCH_KEY = "no such key"
    KEY_TAKEN = "key taken"
    KEY_RESERVED = "key reserved"


class AppError(CodedError):
    """A configuration, process or session that can't go on."""
