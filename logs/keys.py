"""The console's Ed25519 key (made once, 0600, its public half exported), and the anchors beside it.

An anchor is the newest record of a journal that the console has settled: neither the last sessions nor the last
change, comment or sign-in can be removed unseen.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import msgspec
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
    load_pem_private_key,
    load_pem_public_key,
)
from msgspec import Struct

from logs.disk import Disk
from logs.errors import AuditError, AuditFault
from logs.reading.errors import cause_of
from logs.reading.formats import read_json
from logs.reading.regular import read_bytes

ANCHOR_FOLDER = "ends"  # one file for each journal
_FORMER_ANCHOR = "history.json"  # of the manifest alone, as homes of before have it


class Anchor(Struct, frozen=True, kw_only=True):
    """The newest record of a journal that was settled."""

    file: str
    entries: int
    hash: str


def read_anchors(folder: Path) -> dict[str, Anchor]:
    """The anchors in a console's key folder by their journals' names. Raises AuditError when one is damaged."""
    anchors: dict[str, Anchor] = {}
    for path in (folder / _FORMER_ANCHOR, *sorted((folder / ANCHOR_FOLDER).glob("*.json"))):
        try:
            anchor = read_json(path, Anchor)
        except (FileNotFoundError, NotADirectoryError):
            continue
        except OSError as error:
            raise AuditError(AuditFault.ANCHOR_DAMAGED, path=path, detail=cause_of(error)) from error
        anchors[anchor.file] = anchor
    return anchors


def write_anchor(folder: Path, anchor: Anchor, disk: Disk) -> None:
    """Replace a journal's anchor at once. Raises OSError; the former one then stays."""
    ends = folder / ANCHOR_FOLDER
    ends.mkdir(exist_ok=True, mode=0o700)
    replace_file(ends / f"{anchor.file}.json", msgspec.json.encode(anchor), disk)


def replace_file(path: Path, data: bytes, disk: Disk) -> None:
    """Put a whole new file in the place of an old one, 0600. Raises OSError; the old one then stays."""
    partial = path.with_name(path.name + ".partial")
    partial.unlink(missing_ok=True)  # of an attempt that failed; it was never used
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


KEY_FILE = "console.key"
MAX_KEY = 1 << 16  # bytes of a PEM
PUBLIC_FILE = "console.pub"


@dataclass(frozen=True, slots=True)
class PublicKey:
    """A console's public key and its fingerprint, the SHA-256 of its DER form in hex."""

    key: Ed25519PublicKey
    fingerprint: str

    @property
    def pem(self) -> bytes:
        """As a file that openssl reads."""
        return self.key.public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)

    def verifies(self, signature_hex: str, message: bytes) -> bool:
        """Whether the signature, lower-case hex, is this key's over the message."""
        try:
            signature = bytes.fromhex(signature_hex)
            if signature.hex() != signature_hex:
                return False
            self.key.verify(signature, message)
        except (ValueError, InvalidSignature):
            return False
        return True


@dataclass(frozen=True, slots=True)
class ConsoleKey:
    """The private key, for signing only."""

    key: Ed25519PrivateKey
    public: PublicKey
    folder: Path
    was_exposed: bool = False  # others could read the file; its mode has been corrected

    def sign(self, message: bytes) -> str:
        """The signature in lower-case hex."""
        return self.key.sign(message).hex()


def public_key(key: Ed25519PublicKey) -> PublicKey:
    """With its fingerprint."""
    der = key.public_bytes(Encoding.DER, PublicFormat.SubjectPublicKeyInfo)
    return PublicKey(key, sha256(der).hexdigest())


def load_or_make_key(folder: Path, disk: Disk | None = None) -> ConsoleKey:
    """The console's key in `folder`, made at the first call. Raises AuditError when it can't be used."""
    path = folder / KEY_FILE
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        if not path.exists():
            _make(folder, disk or Disk())
        return _load(path)
    except OSError as error:
        raise AuditError(AuditFault.KEY_UNUSABLE, path=path, detail=cause_of(error)) from error


def load_public_key(path: Path) -> PublicKey:
    """A public key from a PEM file. Raises AuditError when it isn't an Ed25519 one."""
    try:
        key = load_pem_public_key(read_bytes(path, MAX_KEY))
    except OSError as error:
        raise AuditError(AuditFault.PUBLIC_KEY_UNREADABLE, path=path, detail=cause_of(error)) from error
    except (ValueError, UnsupportedAlgorithm) as error:
        raise AuditError(AuditFault.PUBLIC_KEY_NOT_PEM, path=path) from error
    if not isinstance(key, Ed25519PublicKey):
        raise AuditError(AuditFault.PUBLIC_KEY_NOT_ED25519, path=path)
    return public_key(key)


def known_keys(folder: Path) -> tuple[PublicKey, ...]:
    """Every public key kept in a console's key folder; none when there is no such folder."""
    return tuple(load_public_key(path) for path in sorted(folder.glob("*.pub")))


def by_fingerprint(keys: Iterable[PublicKey]) -> dict[str, PublicKey]:
    """For looking up the key that a record names."""
    return {key.fingerprint: key for key in keys}


def _make(folder: Path, disk: Disk) -> None:
    key = Ed25519PrivateKey.generate()
    public = public_key(key.public_key())
    private_pem = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    _keep_former_public(folder, disk)
    replace_file(folder / PUBLIC_FILE, public.pem, disk)
    replace_file(folder / KEY_FILE, private_pem, disk)


def _keep_former_public(folder: Path, disk: Disk) -> None:
    former = folder / PUBLIC_FILE
    if former.exists():  # sessions signed by a former key must stay verifiable
        disk.rename(former, folder / f"console-{load_public_key(former).fingerprint[:8]}.pub")


def _load(path: Path) -> ConsoleKey:
    exposed = bool(path.stat().st_mode & 0o077)
    if exposed:
        path.chmod(0o600)
    try:
        key = load_pem_private_key(read_bytes(path, MAX_KEY), password=None)
    except (ValueError, TypeError, UnsupportedAlgorithm) as error:
        raise AuditError(AuditFault.KEY_DAMAGED, path=path) from error
    if not isinstance(key, Ed25519PrivateKey):
        raise AuditError(AuditFault.KEY_NOT_ED25519, path=path)
    return ConsoleKey(key, public_key(key.public_key()), path.parent, exposed)
