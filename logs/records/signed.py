"""Records with a signature: checkpoints, the manifest's entries, comments."""

from __future__ import annotations

from msgspec import Struct

from logs.reason import Cause, Hex


class Checkpoint(Struct, frozen=True, kw_only=True, tag_field="kind", tag="checkpoint"):
    """The console's signature over everything before it in this file."""

    records: int
    closing: bool
    key: Hex  # SHA-256 of the public key's DER
    signature: Hex = ""


class LogOpened(Struct, frozen=True, kw_only=True, tag_field="kind", tag="log-opened"):
    """Manifest: a session's file was begun."""

    file: str
    key: Hex
    signature: Hex = ""


class LogClosed(Struct, frozen=True, kw_only=True, tag_field="kind", tag="log-closed"):
    """Manifest: a session's file was closed in good order."""

    file: str
    records: int
    last_hash: Hex
    key: Hex
    signature: Hex = ""


class LogRecovered(Struct, frozen=True, kw_only=True, tag_field="kind", tag="log-recovered"):
    """Manifest: a file was found unclosed at the next start; how it was found, torn tail included."""

    file: str
    records: int
    last_hash: Hex
    torn_bytes: int
    torn_sha256: Hex
    text: Cause
    key: Hex
    signature: Hex = ""


class Comment(Struct, frozen=True, kw_only=True, tag_field="kind", tag="comment"):
    """A reviewer's comment on one record of a session, in a signed file of its own."""

    about_sequence: int
    about_hash: Hex
    text: str
    key: Hex
    signature: Hex = ""


SignedBody = Checkpoint | LogOpened | LogClosed | LogRecovered | Comment
