"""A recording by its index says what the whole file says, whole or cut, at any time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.recording import schemas
from app.recording.index import RecordingIndex
from app.recording.read import Recording, RecordingReadFault, Sample, messages
from app.recording.schemas import TOPICS
from app.recording.writer import RecordingWriter
from app.system.errors import AppError
from tests.app.recording.conftest import Session

TOPIC_NAMES = [topic.name for topic in TOPICS]


def whole(path: Path) -> list[Sample]:
    return sorted(messages(Recording(path=path)), key=lambda one: one.at_ns)


@given(data=st.data(), topic=st.sampled_from(TOPIC_NAMES))
@settings(max_examples=60, deadline=None)
def test_any_stretch_of_any_topic(recorded: Session, data: st.DataObject, topic: str) -> None:
    found = [one for one in whole(recorded.path) if one.topic == topic]
    with RecordingIndex(recorded.path) as index:
        times = st.integers(index.begin_ns - 10**9, index.end_ns + 10**9)
        after_ns, until_ns = sorted((data.draw(times), data.draw(times)))
        wanted = [one for one in found if after_ns < one.at_ns <= until_ns]
        assert sorted(index.between(topic, after_ns, until_ns), key=str) == sorted(wanted, key=str)
        newest = index.newest(topic, until_ns, until_ns - after_ns)
        assert (newest.at_ns if newest else None) == (wanted[-1].at_ns if wanted else None)


def test_the_joints_are_the_messages(recorded: Session) -> None:
    with RecordingIndex(recorded.path) as index:
        samples = index.joints(schemas.JOINT_STATE, index.begin_ns - 1, index.end_ns)
    assert samples.at_ns.tolist() == [at_ns for at_ns, _, _ in recorded.ticks]
    assert np.array_equal(samples.values[:, 0], [measured for _, measured, _ in recorded.ticks])


@pytest.mark.parametrize("share", [0.5, 0.8, 0.99])
def test_a_cut_file_reads_to_its_last_whole_chunk(recorded: Session, tmp_path: Path, share: float) -> None:
    cut = tmp_path / recorded.path.name
    data = recorded.path.read_bytes()
    cut.write_bytes(data[: int(len(data) * share)])
    readable = whole(cut)
    with RecordingIndex(cut) as index:
        assert index.cut
        assert (index.begin_ns, index.end_ns) == (readable[0].at_ns, readable[-1].at_ns)
        found = [one for topic in TOPIC_NAMES for one in index.between(topic, index.begin_ns - 1, index.end_ns)]
    assert sorted(found, key=str) == sorted(readable, key=str)


def test_the_index_and_the_scan_agree(recorded: Session) -> None:
    with RecordingIndex(recorded.path) as index:
        assert not index.cut
        assert sorted(index._indexed(), key=str) == sorted(index._scanned(), key=str)


def test_a_damaged_chunk_is_empty_and_counted(recorded: Session, tmp_path: Path) -> None:
    damaged = tmp_path / recorded.path.name
    with RecordingIndex(recorded.path) as index:
        place = index._places[-1].offset + 200
    data = bytearray(recorded.path.read_bytes())
    data[place] ^= 0xFF
    damaged.write_bytes(data)
    with RecordingIndex(damaged) as index:
        index.between(schemas.GAIT, index.begin_ns, index.end_ns)
        assert len(index.damaged_chunks) == 1


def test_what_is_no_recording_or_empty_is_refused(tmp_path: Path) -> None:
    for name, data, fault in (
        ("foreign.mcap", b"\x89MCAP0\r\n" + b"\x01" + (8).to_bytes(8, "little") + bytes(8), RecordingReadFault.FOREIGN),
        ("text.mcap", b"no recording at all", RecordingReadFault.NOT_MCAP),
    ):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(AppError) as caught:
            RecordingIndex(tmp_path / name)
        assert caught.value.code is fault
    empty = tmp_path / "empty.mcap"
    RecordingWriter(empty, TOPICS, 0).finish()
    with pytest.raises(AppError) as caught:
        RecordingIndex(empty)
    assert caught.value.code is RecordingReadFault.EMPTY
    with pytest.raises(AppError) as caught:
        RecordingIndex(tmp_path / "missing.mcap")
    assert caught.value.code is RecordingReadFault.UNREADABLE
