"""Encrypted at rest: the same messages with the key, none without it, cut or whole."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from typer.testing import CliRunner

from app.cli import cli
from app.recording import schemas
from app.recording.encryption import (
    HEADER_BYTES,
    KEY_BYTES,
    KEY_FILE,
    MAGIC,
    EncryptionFault,
    Sealer,
    key_of,
    load_or_make_secret,
    open_recording,
)
from app.recording.index import RecordingIndex
from app.recording.process import SessionRecording
from app.recording.read import HashCheck, Recording, messages, proof_of, survey
from app.recording.schemas import FootContact, Topic
from app.recording.writer import RecordingWriter
from app.system.config import Config, RecordingConfig
from app.system.errors import AppError
from logs.records import RecordingFile
from tests.app.recording.conftest import Collector, frame, setup_in
from tests.support.disks import full_disk

TOPIC = Topic(name=schemas.CONTACT, schema=FootContact, about="")
CHUNK_NS = 1_000_000_000


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("RLEEX_HOME", str(tmp_path / "other-home"))
    (tmp_path / "logs").mkdir()
    return tmp_path


def write(path: Path, key: bytes | None, chunks: int = 4, a_chunk: int = 5) -> None:
    writer = RecordingWriter(path, [TOPIC], 7, key=key)
    for number in range(chunks):
        for one in range(a_chunk):
            writer.add(
                TOPIC.name, number * a_chunk + one, FootContact(left_n=float(number * a_chunk + one), right_n=0.5)
            )
        writer.settle((number + 1) * CHUNK_NS)
    assert writer.finish()


def numbers(path: Path) -> list[float]:
    return [one.value["left_n"] for one in messages(Recording(path=path))]


def test_read_with_its_key_it_is_the_plain_file(home: Path) -> None:
    key = load_or_make_secret(home / "keys")
    write(home / "logs" / "plain.mcap", None)
    write(home / "logs" / "hidden.mcap", key)
    with open_recording(home / "logs" / "hidden.mcap") as file:
        assert file.read() == (home / "logs" / "plain.mcap").read_bytes()
    found = survey(home / "logs" / "hidden.mcap")
    assert found.whole
    assert found.counts == {TOPIC.name: 20}
    assert numbers(home / "logs" / "hidden.mcap") == [float(one) for one in range(20)]
    with RecordingIndex(home / "logs" / "hidden.mcap") as index:
        assert not index.cut
        newest = index.newest(TOPIC.name, 12, CHUNK_NS)
        assert newest is not None
        assert newest.value["left_n"] == 12.0


def test_nothing_of_the_plain_file_stands_on_the_disk(home: Path) -> None:
    key = load_or_make_secret(home / "keys")
    write(home / "logs" / "plain.mcap", None, chunks=1)
    write(home / "logs" / "a.mcap", key, chunks=1)
    write(home / "logs" / "b.mcap", key, chunks=1)
    plain, one, other = ((home / "logs" / f"{name}.mcap").read_bytes() for name in ("plain", "a", "b"))
    assert one.startswith(MAGIC)
    assert len(one) == len(plain) + HEADER_BYTES
    hidden, again = one[HEADER_BYTES:], other[HEADER_BYTES:]
    for place in range(0, len(plain) - 16, 16):
        assert plain[place : place + 16] not in one
    assert hidden != again  # each file has its own key stream


@given(data=st.binary(min_size=1, max_size=400), places=st.lists(st.tuples(st.integers(0, 420), st.integers(0, 90))))
def test_it_is_read_at_any_place(
    data: bytes, places: list[tuple[int, int]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    home = tmp_path_factory.mktemp("home")
    (home / "logs").mkdir()
    sealer = Sealer(load_or_make_secret(home / "keys"))
    middle = len(data) // 3
    path = home / "logs" / "x.mcap"
    path.write_bytes(sealer.header + sealer.seal(data[:middle]) + sealer.seal(data[middle:]))
    with open_recording(path) as file:
        for at, length in places:
            assert file.seek(at) == at
            assert file.read(length) == data[at : at + length]
            assert file.tell() == at + len(data[at : at + length])
        assert file.seek(-1, os.SEEK_END) == len(data) - 1
        assert file.read() == data[-1:]


def test_cut_at_any_byte_it_is_read_to_there(home: Path) -> None:
    write(home / "logs" / "whole.mcap", load_or_make_secret(home / "keys"), chunks=3, a_chunk=2)
    data, path = (home / "logs" / "whole.mcap").read_bytes(), home / "logs" / "cut.mcap"
    most = 0
    for length in range(HEADER_BYTES + 64, len(data), 7):
        path.write_bytes(data[:length])
        found = numbers(path)
        assert found == [float(one) for one in range(len(found))]
        assert len(found) >= most
        most = len(found)
        if found:
            with RecordingIndex(path) as index:
                newest = index.newest(TOPIC.name, len(found), CHUNK_NS)
            assert newest is not None
            assert newest.value["left_n"] == found[-1]
    assert most == 6


@pytest.mark.parametrize("keys", [[], [b"x" * KEY_BYTES], [b"x" * KEY_BYTES, b"short"]], ids=["none", "another", "cut"])
def test_without_its_key_the_sentence_says_where_it_belongs(home: Path, keys: list[bytes]) -> None:
    key, path = os.urandom(KEY_BYTES), home / "logs" / "20261122T100000Z-0001.mcap"
    write(path, key)
    (home / "keys").mkdir()
    for number, other in enumerate(keys):
        (home / "keys" / f"recording-{number}.key").write_bytes(other)
    with pytest.raises(AppError) as caught:
        survey(path)
    assert caught.value.code is EncryptionFault.NO_KEY
    (home / "keys" / "recording-ours.key").write_bytes(key)
    assert survey(path).whole


def test_a_key_is_made_once_for_its_owner_alone_and_a_cut_one_is_refused(home: Path) -> None:
    key = load_or_make_secret(home / "keys")
    assert load_or_make_secret(home / "keys") == key
    assert (home / "keys" / KEY_FILE).stat().st_mode & 0o777 == 0o600
    (home / "keys" / KEY_FILE).write_bytes(key[:5])
    with pytest.raises(OSError, match="not a key"):
        load_or_make_secret(home / "keys")


def test_a_key_that_a_full_disk_did_not_take_is_made_when_there_is_room(home: Path) -> None:
    with full_disk(at_bytes=KEY_BYTES - 1), pytest.raises(OSError, match="large"):
        load_or_make_secret(home / "keys")
    assert list((home / "keys").iterdir()) == []
    key = load_or_make_secret(home / "keys")
    assert len(key) == KEY_BYTES
    assert load_or_make_secret(home / "keys") == key
    assert [path.name for path in (home / "keys").iterdir()] == [KEY_FILE]


def test_an_empty_key_that_a_crash_has_left_is_made_anew(home: Path) -> None:
    (home / "keys").mkdir()
    (home / "keys" / KEY_FILE).touch()
    key = load_or_make_secret(home / "keys")
    assert len(key) == KEY_BYTES
    assert (home / "keys" / KEY_FILE).read_bytes() == key


@pytest.mark.parametrize("linked", [True, False], ids=["linked", "no links (exFAT)"])
def test_a_key_takes_its_name_once_it_is_whole_and_of_two_makers_the_first_wins(
    home: Path, monkeypatch: pytest.MonkeyPatch, linked: bool
) -> None:
    link, found = os.link, []

    def named(source: Path, target: Path) -> None:
        found.append(source.read_bytes())
        if not linked:
            raise PermissionError(errno.EPERM, os.strerror(errno.EPERM))
        target.write_bytes(b"x" * KEY_BYTES)  # another process was faster
        link(source, target)

    monkeypatch.setattr(os, "link", named)
    key = load_or_make_secret(home / "keys")
    assert [len(one) for one in found] == [KEY_BYTES]
    assert key == (b"x" * KEY_BYTES if linked else found[0])
    assert [path.name for path in (home / "keys").iterdir()] == [KEY_FILE]


def test_a_session_that_is_to_be_encrypted_is_with_its_hash_in_the_trail(home: Path) -> None:
    sink = Collector()
    setup = replace(setup_in(home), config=Config(recording=RecordingConfig(on=True, encrypt=True)))
    recording = SessionRecording(setup, sink)
    for number in range(1, 6):
        recording.take(frame(number, number * 33_000_000))
    recording.settle(CHUNK_NS)
    recording.close()
    path = recording.writer.path
    assert path.read_bytes().startswith(MAGIC)
    assert survey(path).counts[schemas.VERDICT] == 5
    (record,) = [body for body in sink.bodies if isinstance(body, RecordingFile)]
    assert record.sha256 == recording.writer.sha256
    assert record.size_bytes == path.stat().st_size
    assert key_of(path) is not None
    assert proof_of(path) == (HashCheck.NO_TRAIL, None)
    shown = CliRunner().invoke(cli, ["recording", "info", "last", "--home", str(home)])
    assert shown.exit_code == 0
    assert str(key_of(path)) in shown.output
