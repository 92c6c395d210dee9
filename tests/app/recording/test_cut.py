"""A crash, a cut, a foreign file, a disk that refuses: what was written is read, what was lost is counted."""

from __future__ import annotations

import errno
import multiprocessing
import random
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from multiprocessing.connection import Connection
from pathlib import Path

import pytest
from mcap.writer import Writer

from app.recording import schemas
from app.recording.encryption import load_or_make_secret
from app.recording.read import Recording, RecordingReadFault, messages, survey
from app.recording.schemas import FootContact, Topic
from app.recording.writer import LIBRARY, MOST_PENDING, PROFILE, VERSION, RecorderFault, RecordingWriter
from app.system.errors import AppError
from logs.disk import Disk

TOPIC = Topic(name=schemas.CONTACT, schema=FootContact, about="")
PER_CHUNK = 50
SMALL = 12  # messages of a file that is damaged at each of its bytes
CHUNK_NS = 1_000_000_000


def write_chunk(writer: RecordingWriter, number: int, count: int = PER_CHUNK) -> None:
    """One chunk of numbered messages."""
    for one in range(number * count, (number + 1) * count):
        writer.add(TOPIC.name, one, FootContact(left_n=float(one), right_n=random.random()))
    writer.settle((number + 1) * CHUNK_NS)


def numbers(path: Path) -> list[int]:
    return [int(one.value["left_n"]) for one in messages(Recording(path=path))]


def write_chunks(path: Path, key: bytes | None, written: Connection) -> None:
    """Chunk after chunk, until killed."""
    writer = RecordingWriter(path, [TOPIC], 0, key=key)
    for number in range(1_000_000):
        write_chunk(writer, number)
        written.send(number)


def received(written: Connection) -> Iterator[int]:
    """The numbers of the written chunks, to the writer's end."""
    with suppress(EOFError):
        while True:
            yield written.recv()


@pytest.mark.serial
def test_killed_at_any_moment_it_loses_at_most_the_newest_chunk(tmp_path: Path) -> None:
    rng = random.Random(17)
    (tmp_path / "logs").mkdir()
    key = load_or_make_secret(tmp_path / "keys")
    context = multiprocessing.get_context("forkserver")  # this process has threads: a copy of it may hang
    context.set_forkserver_preload([__name__])
    for attempt in range(50):
        path = tmp_path / "logs" / f"{attempt}.mcap"
        reads, writes = context.Pipe(duplex=False)
        child = context.Process(target=write_chunks, args=(path, key if attempt % 2 else None, writes), daemon=True)
        child.start()
        writes.close()
        with reads:
            sent = received(reads)
            done = [*islice(sent, rng.randint(1, 30))]
            for _ in range(rng.randint(0, 20_000)):  # a moment within a chunk
                pass
            child.kill()
            child.join()
            done += sent
        found = numbers(path)
        assert found == list(range(len(found)))
        whole_chunks = done[-1] + 1
        assert whole_chunks * PER_CHUNK <= len(found) <= (whole_chunks + 1) * PER_CHUNK
        assert not survey(path).whole


@pytest.fixture(scope="session")
def small(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("small") / "s.mcap"
    writer = RecordingWriter(path, [TOPIC], 7)
    for number in range(SMALL // 3):
        write_chunk(writer, number, 3)
    assert writer.finish()
    return path.read_bytes()


HEAD = 64  # magic and header: what is damaged there is no recording


def test_cut_at_any_byte_it_is_read_to_there(small: bytes, tmp_path: Path) -> None:
    path = tmp_path / "s.mcap"
    for at in range(HEAD, len(small)):
        path.write_bytes(small[:at])
        found = numbers(path)
        assert found == list(range(len(found))), at
        assert not survey(path).whole, at


def test_a_damaged_byte_changes_no_message_and_is_told_when_it_hides_one(small: bytes, tmp_path: Path) -> None:
    """A chunk whose kind of record is unreadable is left out; those after it are read."""
    path = tmp_path / "s.mcap"
    first_message = 180  # before it: the clock's metadata, and the head of the first chunk
    for at in range(HEAD, len(small)):
        for changed in [1 << bit for bit in range(8)] if at < first_message else [0xFF]:
            path.write_bytes(small[:at] + bytes([small[at] ^ changed]) + small[at + 1 :])
            found = numbers(path)
            assert found == sorted(set(found) & set(range(SMALL))), (at, changed)
            read = survey(path)
            assert len(found) == SMALL or read.damage or not read.whole, (at, changed)


def test_a_damaged_head_is_refused_or_harmless(small: bytes, tmp_path: Path) -> None:
    path = tmp_path / "s.mcap"
    for at in range(HEAD):
        for damaged in (small[:at], small[:at] + bytes([small[at] ^ 0xFF]) + small[at + 1 :]):
            path.write_bytes(damaged)
            with suppress(AppError):
                assert numbers(path) in ([], list(range(SMALL))), at


def write_other(path: Path, profile: str, library: str) -> Path:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile=profile, library=library)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        (b"", RecordingReadFault.NOT_MCAP),
        (b"hello, world, this is text", RecordingReadFault.NOT_MCAP),
        (("ros2", "libmcap"), RecordingReadFault.FOREIGN),
        ((PROFILE, f"{LIBRARY} {VERSION + 1}"), RecordingReadFault.NEWER),
        ((PROFILE, f"{LIBRARY} x"), RecordingReadFault.NEWER),
    ],
)
def test_what_is_no_recording_is_refused(
    tmp_path: Path, content: bytes | tuple[str, str], fault: RecordingReadFault
) -> None:
    path = tmp_path / "x.mcap"
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        write_other(path, *content)
    with pytest.raises(AppError) as caught:
        survey(path)
    assert caught.value.code is fault


class FullDisk(Disk):
    """Takes so many bytes, then half a write, then none, until `room` grows."""

    def __init__(self, room: int) -> None:
        self.room = room

    def write(self, handle: int, data: bytes, offset: int) -> int:
        if self.room == 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        taken = super().write(handle, data[: self.room], offset)
        self.room -= taken
        return taken


def test_a_disk_that_fills_and_is_freed_leaves_a_whole_file(tmp_path: Path) -> None:
    disk = FullDisk(6_000)
    writer = RecordingWriter(tmp_path / "s.mcap", [TOPIC], 0, disk=disk)
    for number in range(20):
        if number == 15:
            disk.room = 1 << 30
        write_chunk(writer, number)
        if number == 14:
            assert 0 < writer.size_bytes <= 6_000  # the rest waits
    assert writer.finish()
    found = survey(writer.path)
    assert found.counts[TOPIC.name] == writer.written[TOPIC.name] == 20 * PER_CHUNK
    assert writer.fault is not None
    assert writer.fault.code == f"RecorderFault.{RecorderFault.DISK.name}"


def test_a_disk_that_stays_full_costs_messages_that_are_counted(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "s.mcap", [TOPIC], 0, disk=FullDisk(20_000))
    sent, big = 0, b'{"left_n":1,"x":"' + random.Random(1).randbytes(1 << 19).hex().encode() + b'"}'
    for number in range(3 * MOST_PENDING // len(big)):
        writer.add(TOPIC.name, number, big)
        sent += 1
        writer.settle(number * CHUNK_NS)
    assert writer.lost[TOPIC.name] > 0
    assert writer.written[TOPIC.name] + writer.lost[TOPIC.name] == sent
    assert not writer.finish()
    assert not survey(writer.path).whole


def test_the_trails_part_of_the_disk_stays_free(tmp_path: Path) -> None:
    free = [10_000]
    writer = RecordingWriter(tmp_path / "s.mcap", [TOPIC], 0, floor_bytes=5_000, free_bytes=lambda _: free[0])
    write_chunk(writer, 0)
    free[0] = 4_000
    write_chunk(writer, 1)
    write_chunk(writer, 2)
    free[0] = 10_000
    write_chunk(writer, 3)
    write_chunk(writer, 4)
    assert writer.finish()
    assert writer.lost[TOPIC.name] == 2 * PER_CHUNK
    assert survey(writer.path).lost == {TOPIC.name: 2 * PER_CHUNK}
    assert numbers(writer.path) == [*range(2 * PER_CHUNK), *range(4 * PER_CHUNK, 5 * PER_CHUNK)]
