"""The camera's pictures: with the consent alone, lost before anything else, and gone when the consent is withdrawn."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from msgspec import json
from msgspec.structs import replace
from typer.testing import CliRunner

from app.cli import cli
from app.ipc.links import OrderedReceiver, address, new_link_directory
from app.ipc.recording import Picture
from app.ipc.streams import PICTURES
from app.perception.recording import WIDTH_PX, PictureRecorder, encode
from app.recording import read, schemas
from app.recording.pictures import MOST_BEHIND, PicturesFile
from app.recording.read import RecordingReadFault, find_recording, messages, survey
from app.recording.schemas import CompressedImage
from app.system.errors import AppError
from app.system.paths import Home, pictures_path, recording_path
from app.text.catalogue import render, use_language
from hal.cameras.camera import Frame, Intrinsics, IntrinsicsSource
from logs.disk import Disk
from logs.journal import CHANGES
from logs.keys import load_or_make_key
from logs.read import records
from logs.records import Change, Note, Recording, RecordingDeleted, RecordingFile
from tests.app.recording.conftest import Collector
from tests.support.audit_trails import write_session

OFFSET_NS = 7_000_000_000
AGREED, WITHDRAWN = Recording(on=True, consent=True), Recording(on=False, consent=False)
SOURCE = IntrinsicsSource.GIVEN
LENS = Intrinsics(width_px=1280, height_px=720, fx_px=900.0, fy_px=900.0, cx_px=640.0, cy_px=360.0, source=SOURCE)


def frame(number: int = 1, captured_ns: int = 1_000_000_000, depth: bool = True) -> Frame:
    image = np.full((720, 1280, 3), (40, 120, 200), np.uint8)
    depth_m = np.full((720, 1280), 0.4321, np.float32)
    depth_m[:, :640] = 0.0
    depth_m[:, 1000:] = 1e4
    return Frame(
        image_bgr=image,
        captured_ns=captured_ns,
        sequence=number,
        intrinsics=LENS,
        depth_m=depth_m if depth else None,
    )


def pictures(count: int, lost: int = 0, incarnation: int = 1) -> list[Picture]:
    made = encode(frame(), lost, incarnation)
    return [replace(made, captured_ns=number * 100_000_000) for number in range(1, count + 1)]


@pytest.fixture
def collector() -> Collector:
    return Collector()


@pytest.fixture
def file(tmp_path: Path, collector: Collector) -> PicturesFile:
    return PicturesFile(tmp_path, "s", OFFSET_NS, collector)


def test_a_picture_is_smaller_and_a_hole_of_the_depth_stays_one() -> None:
    made = encode(frame(), lost=3)
    image = cv2.imdecode(np.frombuffer(made.image_jpeg, np.uint8), cv2.IMREAD_COLOR)
    depth = cv2.imdecode(np.frombuffer(made.depth_png, np.uint8), cv2.IMREAD_UNCHANGED)
    assert image is not None
    assert depth is not None
    assert image.shape == (360, WIDTH_PX, 3)
    assert np.abs(image.astype(int) - (40, 120, 200)).max() <= 4
    assert depth.shape == (360, WIDTH_PX)
    assert depth.dtype == np.uint16
    assert {int(value) for value in np.unique(depth)} == {0, 432, 65535}
    assert (made.captured_ns, made.lost) == (1_000_000_000, 3)
    assert encode(frame(depth=False)).depth_png == b""


def test_with_the_consent_every_picture_is_there(file: PicturesFile, collector: Collector) -> None:
    file.follow(AGREED)
    file.follow(Note(text="nothing about pictures"))
    sent = pictures(5)
    for one in sent:
        file.take(one, 0)
        file.settle(one.captured_ns)
    file.close()
    found = [
        (one.topic, one.at_ns, json.decode(one.data, type=CompressedImage))
        for one in messages(read.Recording(path=file.path))
    ]
    images = [(at_ns, image.data) for topic, at_ns, image in found if topic == schemas.IMAGE]
    depths = [(at_ns, image.data) for topic, at_ns, image in found if topic == schemas.DEPTH]
    assert images == [(one.captured_ns, one.image_jpeg) for one in sent]
    assert depths == [(one.captured_ns, one.depth_png) for one in sent]
    assert {image.format for topic, _, image in found if topic == schemas.DEPTH} == {"png"}
    assert found[0][2].timestamp == schemas.time_of(sent[0].captured_ns + OFFSET_NS)
    (record,) = collector.bodies
    assert isinstance(record, RecordingFile)
    assert (record.file, record.whole, record.lost) == ("s.pictures.mcap", True, {})
    assert record.sha256 == sha256(file.path.read_bytes()).hexdigest()


def test_the_libraries_own_reader_finds_foxgloves_schema(file: PicturesFile) -> None:
    file.follow(AGREED)
    file.take(pictures(1)[0], 0)
    file.close()
    with file.path.open("rb") as opened:
        found = [(schema.name, channel.topic) for schema, channel, _ in make_reader(opened).iter_messages() if schema]
    assert found == [("foxglove.CompressedImage", schemas.IMAGE), ("foxglove.CompressedImage", schemas.DEPTH)]


def test_without_the_consent_there_is_no_file(file: PicturesFile, collector: Collector) -> None:
    for one in pictures(3):
        file.take(one, 0)
        file.settle(one.captured_ns)
    file.close()
    assert not file.path.exists()
    assert collector.bodies == []


def test_withdrawn_it_is_deleted_and_nothing_more_is_taken(file: PicturesFile, collector: Collector) -> None:
    file.follow(AGREED)
    for one in pictures(4):
        file.take(one, 0)
    file.settle(1_000_000_000)
    size_bytes = file.path.stat().st_size
    file.follow(WITHDRAWN)
    file.settle(2_000_000_000)
    assert not file.path.exists()
    assert collector.bodies == [RecordingDeleted(file="s.pictures.mcap", size_bytes=size_bytes, messages=8)]
    file.take(pictures(1)[0], 0)
    file.settle(3_000_000_000)
    file.close()
    assert not file.path.exists()
    assert len(collector.bodies) == 1


def test_withdrawn_at_the_sessions_end_it_is_deleted_all_the_same(file: PicturesFile, collector: Collector) -> None:
    file.follow(AGREED)
    file.take(pictures(1)[0], 0)
    file.follow(WITHDRAWN)
    file.close()
    assert not file.path.exists()
    assert [type(body) for body in collector.bodies] == [RecordingDeleted]


def test_agreed_again_only_what_comes_then_is_kept(file: PicturesFile, collector: Collector) -> None:
    before, after = pictures(2)
    for consent, one in ((AGREED, before), (WITHDRAWN, before), (AGREED, after)):
        file.follow(consent)
        file.take(one, 0)
        file.settle(one.captured_ns)
    file.close()
    assert [one.at_ns for one in messages(read.Recording(path=file.path), schemas.IMAGE)] == [after.captured_ns]
    assert [type(body) for body in collector.bodies] == [RecordingDeleted, RecordingFile]


def test_a_disk_that_is_behind_costs_pictures_first(file: PicturesFile, collector: Collector) -> None:
    file.follow(AGREED)
    for one, waiting_bytes in zip(pictures(4, lost=2), (0, MOST_BEHIND + 1, MOST_BEHIND + 1, 0), strict=True):
        file.take(one, waiting_bytes)
    file.close()
    assert survey(file.path).counts[schemas.IMAGE] == 2
    (record,) = collector.bodies
    assert isinstance(record, RecordingFile)
    assert record.lost == {schemas.IMAGE: 4, schemas.DEPTH: 4}  # two of them on their way here


def test_without_depth_only_images_are_lost(file: PicturesFile, collector: Collector) -> None:
    file.follow(AGREED)
    file.take(replace(encode(frame(depth=False)), lost=3), 0)
    file.close()
    (record,) = collector.bodies
    assert isinstance(record, RecordingFile)
    assert record.lost == {schemas.IMAGE: 3}


def test_pictures_lost_before_perception_was_restarted_stay_counted(file: PicturesFile, collector: Collector) -> None:
    file.follow(AGREED)
    for incarnation, lost in ((1, 1), (1, 3), (2, 5), (3, 0), (3, 2)):
        file.take(pictures(1, lost, incarnation)[0], 0)
    file.close()
    (record,) = collector.bodies
    assert isinstance(record, RecordingFile)
    assert record.lost == dict.fromkeys((schemas.IMAGE, schemas.DEPTH), 3 + 5 + 2)


def test_agreed_again_the_new_file_lacks_only_its_own_losses(file: PicturesFile, collector: Collector) -> None:
    for consent, lost in ((AGREED, 3), (WITHDRAWN, 3), (AGREED, 5)):
        file.follow(consent)
        file.take(pictures(1, lost=lost)[0], 0)
        file.settle(1_000_000_000)
    file.close()
    record = collector.bodies[-1]
    assert isinstance(record, RecordingFile)
    assert record.lost == {schemas.IMAGE: 2, schemas.DEPTH: 2}


def test_a_file_that_cannot_be_made_is_told_in_the_trail(file: PicturesFile, collector: Collector) -> None:
    file.path.write_bytes(b"somebody's")
    file.follow(AGREED)
    file.take(pictures(1)[0], 0)
    file.close()
    (record,) = collector.bodies
    assert isinstance(record, RecordingFile)
    assert (record.whole, record.lost, record.size_bytes) == (False, {schemas.IMAGE: 1}, 0)
    assert record.fault is not None
    assert file.path.read_bytes() == b"somebody's"


def test_perception_sends_nothing_before_it_is_switched_on_and_ten_a_second_then(tmp_path: Path) -> None:
    links = new_link_directory(tmp_path)
    receiver: OrderedReceiver[Picture] = OrderedReceiver(address(links, PICTURES.name), Picture)
    recorder = PictureRecorder(links)
    recorder.take(frame(1, 1_000_000_000))
    recorder.on = True
    wanted = [2_000_000_000 + number * 100_000_001 for number in range(10)]
    got = []
    for captured_ns in wanted:
        for later_ns in (0, 33_000_000, 66_000_000):  # the first of the three is due
            recorder.take(frame(1, captured_ns + later_ns, depth=False))
        message = receiver.receive(10.0)
        assert message is not None
        assert message.incarnation > 0
        got.append(message.captured_ns)
    recorder.close()
    assert receiver.receive(0.0) is None
    receiver.close()
    assert got == wanted


def home_with(tmp_path: Path) -> Home:
    """A session's recording and pictures; their content does not matter here."""
    home = Home(tmp_path / "home")
    home.logs.mkdir(parents=True)
    for path in (recording_path(home.logs, "s1"), pictures_path(home.logs, "s1"), recording_path(home.logs, "s2")):
        path.write_bytes(b"12345")
    return home


def test_the_last_recording_is_of_the_session_begun_last_whatever_the_clock_was_set_to(tmp_path: Path) -> None:
    home = home_with(tmp_path)
    key = load_or_make_key(home.keys)
    for name in ("s2", "s1"):
        write_session(home.logs, name, key, Disk())
    assert find_recording(home.logs, "last") == recording_path(home.logs, "s1")


def test_pictures_are_no_recording_of_their_own(tmp_path: Path) -> None:
    home = home_with(tmp_path)
    assert find_recording(home.logs, "s1") == recording_path(home.logs, "s1")
    assert find_recording(home.logs, str(home.logs / "s1.jsonl")) == recording_path(home.logs, "s1")
    assert find_recording(home.logs, "last") == recording_path(home.logs, "s2")


@pytest.mark.parametrize(
    ("named", "fault", "begins"),
    [
        ("s", RecordingReadFault.AMBIGUOUS, "{folder} has 2 recordings whose name begins with s."),
        ("nobody", RecordingReadFault.NO_RECORDING, "{folder} has no recording named nobody."),
        ("", RecordingReadFault.NO_RECORDING, "{folder} has no recording"),
    ],
)
def test_a_name_that_begins_several_recordings_or_none_is_refused(
    tmp_path: Path, named: str, fault: RecordingReadFault, begins: str
) -> None:
    use_language("en")
    home = home_with(tmp_path)
    with pytest.raises(AppError) as caught:
        find_recording(home.logs, named)
    assert caught.value.code is fault
    assert render(caught.value).startswith(begins.format(folder=home.logs))


def test_a_consent_withdrawn_later_deletes_them_on_record(tmp_path: Path) -> None:
    home = home_with(tmp_path)
    command = ["recording", "delete-pictures", "s1", "--home", str(home.root)]
    done = CliRunner().invoke(cli, command)
    assert done.exit_code == 0, done.output
    assert not pictures_path(home.logs, "s1").exists()
    assert recording_path(home.logs, "s1").exists()
    (journal,) = (path for path in home.logs.parent.rglob(CHANGES) if path.is_file())
    changes = [one.body for one in records(journal) if isinstance(one.body, Change)]
    assert [(one.subject, one.name, one.values) for one in changes] == [
        ("recording", "s1.pictures.mcap", {"size_bytes": (5, None)})
    ]
    again = CliRunner().invoke(cli, command)
    assert isinstance(again.exception, AppError)
    assert again.exception.code is RecordingReadFault.NO_PICTURES


def test_a_consent_that_follows_at_once_undoes_no_withdrawal(file: PicturesFile, collector: Collector) -> None:
    before, between, after = pictures(3)
    file.follow(AGREED)
    file.take(before, 0)
    for consent in (WITHDRAWN, AGREED):
        file.follow(consent)
    file.take(between, 0)
    file.settle(1_000_000_000)
    file.take(after, 0)
    file.close()
    assert [one.at_ns for one in messages(read.Recording(path=file.path), schemas.IMAGE)] == [after.captured_ns]
    deleted, record = collector.bodies
    assert isinstance(deleted, RecordingDeleted)
    assert isinstance(record, RecordingFile)
    assert record.lost == {schemas.IMAGE: 1, schemas.DEPTH: 1}
