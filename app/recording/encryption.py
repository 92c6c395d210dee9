"""Encryption at rest: AES-256 in counter mode under a key of each file, which follows from the station's key.

Counter mode lets a file grow, be read at any place, and be read to where a crash cut it. It hides and does not prove:
that a file is unchanged is what its SHA-256 in the trail says (of the file as it lies on the disk), and each chunk has
a checksum. A file begins with MAGIC, the station key's fingerprint and a random salt; its key is HKDF-SHA256 of the
station's key and the salt (RFC 5869), so no two files share a key stream.
"""

from __future__ import annotations

import io
import os
import secrets
from dataclasses import dataclass
from enum import Enum, auto
from errno import EINVAL
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from app.system.errors import AppError
from app.system.files import partial_file
from app.system.paths import find_home
from logs.disk import Disk
from logs.reading.regular import open_regular, read_bytes

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer
    from cryptography.hazmat.primitives.ciphers import CipherContext

MAGIC = b"RLEEX-AES256CTR\n"
FINGERPRINT_BYTES = 8
SALT_BYTES = 32
HEADER_BYTES = len(MAGIC) + FINGERPRINT_BYTES + SALT_BYTES
KEY_BYTES = 32
KEY_FILE = "recording.key"  # this station's, in the home's key folder; others' lie beside it as recording-NAME.key
KEY_FILES = "recording*.key"
BLOCK_BYTES = 16  # of AES


class EncryptionFault(Enum):
    """Why an encrypted recording can't be read."""

    NO_KEY = auto()  # path, fingerprint, folder


@dataclass(frozen=True, slots=True)
class Header:
    """What stands before the encrypted bytes."""

    fingerprint: bytes
    salt: bytes

    def encode(self) -> bytes:
        """As it lies in the file."""
        return MAGIC + self.fingerprint + self.salt


class Sealer:
    """Encrypts a file's bytes in their order, the header first."""

    def __init__(self, site_key: bytes) -> None:
        header = Header(fingerprint_of(site_key), secrets.token_bytes(SALT_BYTES))
        self._cipher = _cipher(_file_key(site_key, header.salt), 0)
        self.header = header.encode()

    def seal(self, data: bytes) -> bytes:
        """The next bytes."""
        return self._cipher.update(data)


class _Unsealed(io.RawIOBase):
    """The plain bytes of an encrypted file, at any place."""

    def __init__(self, file: BinaryIO, file_key: bytes) -> None:
        self._file = file
        self._key = file_key
        self._at = 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        place = offset + HEADER_BYTES if whence == os.SEEK_SET else offset
        if whence == os.SEEK_CUR:
            place = self._at + offset + HEADER_BYTES
        self._at = self._file.seek(place, os.SEEK_END if whence == os.SEEK_END else os.SEEK_SET) - HEADER_BYTES
        return self._at

    def readinto(self, buffer: WriteableBuffer) -> int:
        view = memoryview(buffer).cast("B")
        self._file.seek(self._at + HEADER_BYTES)
        data = self._file.read(len(view))
        view[: len(data)] = _cipher(self._key, self._at).update(data)
        self._at += len(data)
        return len(data)

    def close(self) -> None:
        self._file.close()
        super().close()


def open_recording(path: Path) -> BinaryIO:
    """A recording's plain bytes, encrypted or not. Raises OSError; AppError where the key is not here.

    The key is looked for in the home that the file lies in, then in the home of this command.
    """
    file = open_regular(path)
    try:
        header = _read_header(file)
        if header is None:
            file.seek(0)
            return file
        key = _find_key(header.fingerprint, path)
        return io.BufferedReader(_Unsealed(file, _file_key(key, header.salt)), 1 << 16)
    except BaseException:
        file.close()
        raise


def load_or_make_secret(folder: Path, name: str = KEY_FILE) -> bytes:
    """A secret of the home in its key folder, 0600, made at first. Raises OSError; a cut one is never left.

    It is on the medium before it is given: what is encrypted by it would be lost with it.
    """
    path = folder / name
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    if path.exists() and not path.stat().st_size:  # an older version was interrupted while it made it
        path.unlink()
    if not path.exists():
        _make_secret(path)
    secret = read_bytes(path, KEY_BYTES)
    if len(secret) != KEY_BYTES:  # a shorter one would hide less
        raise OSError(EINVAL, "not a key", str(path))
    return secret


def _make_secret(path: Path) -> None:
    """Under its name once it is whole; of two processes that make one, the first is kept."""
    with partial_file(path) as partial:
        handle = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
        with os.fdopen(handle, "wb") as file:
            file.write(secrets.token_bytes(KEY_BYTES))
            file.flush()
            os.fsync(handle)
        try:
            os.link(partial, path)
        except OSError:
            if not path.exists():  # a file system without links, such as exFAT
                partial.replace(path)
    Disk().sync_folder(path.parent)


def key_of(path: Path) -> str | None:
    """The fingerprint of the key that a file is encrypted by; None: it is not. Raises OSError."""
    with open_regular(path) as file:
        header = _read_header(file)
    return None if header is None else header.fingerprint.hex()


def fingerprint_of(site_key: bytes) -> bytes:
    """By which a file names the station's key."""
    return sha256(b"rleex recording key" + site_key).digest()[:FINGERPRINT_BYTES]


def _read_header(file: BinaryIO) -> Header | None:
    head = file.read(HEADER_BYTES)
    if not head.startswith(MAGIC) or len(head) < HEADER_BYTES:
        return None
    rest = head[len(MAGIC) :]
    return Header(rest[:FINGERPRINT_BYTES], rest[FINGERPRINT_BYTES:])


def _find_key(fingerprint: bytes, recording: Path) -> bytes:
    folders = [recording.absolute().parent.parent / "keys", find_home().keys]
    for folder in folders:
        for path in sorted(folder.glob(KEY_FILES)):
            key = read_bytes(path, KEY_BYTES)
            if fingerprint_of(key) == fingerprint:
                return key
    raise AppError(EncryptionFault.NO_KEY, path=recording, fingerprint=fingerprint.hex(), folder=folders[0])


def _file_key(site_key: bytes, salt: bytes) -> bytes:
    from cryptography.hazmat.primitives.hashes import SHA256
    from cryptography.hazmat.primitives.kdf.hkdf import HKDF

    return HKDF(algorithm=SHA256(), length=KEY_BYTES, salt=salt, info=MAGIC).derive(site_key)


def _cipher(file_key: bytes, at: int) -> CipherContext:
    """A stream cipher from this byte on; to decrypt is the same as to encrypt."""
    from cryptography.hazmat.primitives.ciphers import Cipher
    from cryptography.hazmat.primitives.ciphers.algorithms import AES
    from cryptography.hazmat.primitives.ciphers.modes import CTR

    block, within = divmod(at, BLOCK_BYTES)
    cipher = Cipher(AES(file_key), CTR(block.to_bytes(BLOCK_BYTES, "big"))).encryptor()
    cipher.update(bytes(within))
    return cipher
