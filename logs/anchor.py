"""What the console remembers of its manifest, kept beside the key: the last sessions can't vanish together unseen."""

from __future__ import annotations

from pathlib import Path

import msgspec
from msgspec import Struct

from logs.disk import Disk
from logs.errors import AuditError

ANCHOR_FILE = "history.json"


class Anchor(Struct, frozen=True, kw_only=True):
    """The newest manifest entry that was settled."""

    file: str
    entries: int
    hash: str


def read_anchor(folder: Path) -> Anchor | None:
    """What a console's key folder remembers; None where there is none. Raises AuditError when it is damaged."""
    path = folder / ANCHOR_FILE
    try:
        return msgspec.json.decode(path.read_bytes(), type=Anchor)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, msgspec.MsgspecError) as error:
        raise AuditError(f"{path}, the memory of the manifest, can't be read: {error}.") from error


def write_anchor(folder: Path, anchor: Anchor, disk: Disk) -> None:
    """Replace the memory at once. Raises OSError; the former one then stays."""
    replace_file(folder / ANCHOR_FILE, msgspec.json.encode(anchor), disk)


def replace_file(path: Path, data: bytes, disk: Disk) -> None:
    """Put a whole new file in the place of an old one, 0600. Raises OSError; the old one then stays."""
    partial = path.with_name(path.name + ".partial")
    partial.unlink(missing_ok=True)  # of an attempt that failed; it was never in use
    handle = disk.create(partial)
    try:
        offset = 0
        while offset < len(data):
            offset += disk.write(handle, data[offset:], offset)
        disk.sync(handle)
    finally:
        disk.close(handle)
    disk.rename(partial, path)
    disk.sync_folder(path.parent)
