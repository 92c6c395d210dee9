"""What the audit trail refuses, as a code with values; the wording is in the catalogues."""

from __future__ import annotations

from enum import Enum, auto

from logs.reading.errors import CodedError


class AuditFault(Enum):
    """Why an audit file or key can't be used."""

    TRAIL_UNREADABLE = auto()  # path, detail
    TRAIL_MISSING = auto()  # path
    TRAIL_EMPTY = auto()  # path
    LINE_TOO_LONG = auto()  # path, limit_mb
    TRAILS_NOT_JOINED = auto()  # first, second
    TRAILS_CONTRADICT = auto()  # first, second, why
    SITE_TWICE = auto()  # site
    SITES_SHARE = auto()  # site, other
    SITE_MISSING = auto()  # site, path
    SITE_AMBIGUOUS = auto()  # site, path
    SITE_EMPTY = auto()  # site, path
    SITE_TAMPERED = auto()  # site, path, why
    SITE_UNREADABLE = auto()  # site, path, detail
    SITE_NEWER = auto()  # path, schema, known
    NOT_AN_EXPORT = auto()  # path, missing
    NO_SPARK = auto()
    NO_JAVA = auto()
    CLUSTER_UNREACHABLE = auto()  # master, detail
    NO_TRAILS = auto()  # places
    NO_SESSION = auto()  # name, folder
    NO_RECORD = auto()  # sequence, last
    AMBIGUOUS_SESSION = auto()  # name, matches, folder
    JOURNAL_UNREADABLE = auto()  # path, detail
    NOT_UTF8 = auto()
    JOURNAL_NOT_WRITTEN = auto()  # cause
    ANCHOR_DAMAGED = auto()  # path, detail
    KEY_UNUSABLE = auto()  # path, detail
    KEY_DAMAGED = auto()  # path
    KEY_NOT_ED25519 = auto()  # path
    PUBLIC_KEY_UNREADABLE = auto()  # path, detail
    PUBLIC_KEY_NOT_PEM = auto()  # path
    PUBLIC_KEY_NOT_ED25519 = auto()  # path
    UNANSWERABLE = auto()  # detail: the query engine's message
    TIME_NOT_SHOWN = auto()  # column
    NOT_A_QUESTION = auto()
    QUESTION_TOO_LONG = auto()  # limit_s
    ANSWER_TOO_LARGE = auto()  # limit_bytes
    UNWRITABLE = auto()  # path, detail


class AuditError(CodedError):
    """An audit file or key that can't be used."""
