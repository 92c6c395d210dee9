"""With the patient's consent a replay shows the camera's picture with the keypoints on it, else the skeleton."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from app.console.widgets.replay import draw_picture
from app.ipc.recording import Picture
from app.playback import frame
from app.playback.film import view_at, whole_of
from app.playback.moment import PICTURE_WITHIN_NS, moment
from app.playback.session import InTime, Playback
from app.playback.view import Legs
from app.recording import schemas
from app.recording.pictures import PicturesFile
from app.recording.read import Recording as ReadRecording
from app.recording.read import messages
from app.system.paths import pictures_path
from logs.records import Camera, Recording
from tests.app.recording.conftest import Collector
from tests.support.recorded_session import SESSION, Lived

GREEN = (60, 200, 60)


@pytest.fixture(scope="module")
def pictured(session: Lived, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recorded session with a green picture of each second frame."""
    folder = tmp_path_factory.mktemp("pictured")
    for path in session.path.parent.iterdir():
        if path.is_file():
            shutil.copy(path, folder / path.name)
    made, jpeg = cv2.imencode(".jpg", np.full((360, 640, 3), GREEN, np.uint8))
    assert made
    recording = ReadRecording(path=session.path)
    frames_ns = [one.at_ns for one in messages(recording, schemas.KEYPOINTS)]
    pictures = PicturesFile(folder, SESSION, recording.clock_offset_ns, Collector())
    pictures.follow(Recording(on=True, consent=True))
    for at_ns in frames_ns[::2]:
        pictures.take(Picture(captured_ns=at_ns, image_jpeg=jpeg.tobytes()), 0)
    pictures.close()
    return folder / session.path.name


@pytest.fixture
def playback(pictured: Path) -> Iterator[Playback]:
    with closing(Playback(pictured)) as opened:
        yield opened


def hand_part(playback: Playback, at_ns: int) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    view = view_at(playback, Legs(playback, playback.wearer()), at_ns)
    return frame.draw(view, whole_of(playback, 1.0))[frame.HAND.y : frame.HAND.bottom, frame.HAND.x : frame.HAND.right]


def green_share(image: np.ndarray[tuple[int, ...], np.dtype[np.uint8]]) -> float:
    return float(np.mean(np.abs(image.astype(int) - GREEN).max(axis=2) < 12))


def with_hand(playback: Playback) -> int:
    """A moment that shows a hand."""
    for at_ns in range(playback.begin_ns, playback.end_ns, 100_000_000):
        now = moment(playback, at_ns)
        if now.hand_m is not None:
            return at_ns
    raise AssertionError("no hand in the whole recording")


def test_the_picture_is_the_newest_before_the_moment(playback: Playback) -> None:
    at_ns = with_hand(playback)
    now = moment(playback, at_ns)
    shown = cv2.imdecode(np.frombuffer(now.picture_jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert shown is not None
    assert np.abs(shown.astype(int) - GREEN).max() < 12
    assert moment(playback, playback.begin_ns - 1).picture_jpeg == b""
    assert moment(playback, playback.end_ns + 2_000_000_000).picture_jpeg == b""


def test_the_film_shows_it_with_the_keypoints_of_its_frame(playback: Playback, session: Lived) -> None:
    at_ns = with_hand(playback)
    drawn = hand_part(playback, at_ns)
    assert green_share(drawn) > 0.5
    with closing(Playback(session.path)) as without:
        assert green_share(hand_part(without, at_ns)) == 0.0


def test_the_keypoints_on_it_are_those_of_its_frame_in_shares_of_the_cameras_width(playback: Playback) -> None:
    at_ns = with_hand(playback)
    assert moment(playback, at_ns).hand_share is None  # this trail names no camera
    use_cameras(playback, (playback.begin_ns, 1280))
    shown = moment(playback, at_ns).hand_share
    picture = playback.pictures.newest(schemas.IMAGE, at_ns, PICTURE_WITHIN_NS) if playback.pictures else None
    assert shown is not None
    assert picture is not None
    found = playback.index.newest(schemas.KEYPOINTS, picture.at_ns, 1)
    assert found is not None
    assert shown.tolist() == (np.array(found.value["image_px"]) / 1280).tolist()


def use_cameras(playback: Playback, *cameras: tuple[int, int]) -> None:
    """The trail's cameras, by moment and width of the images."""
    rest = {"camera": "c", "height_px": 720, "rate_hz": 30.0, "focal_px": 900.0, "intrinsics_source": "given"}
    playback.cameras = InTime(
        msgspec.structs.replace(
            playback.records[0],
            sequence=sequence,
            monotonic_ns=at_ns,
            body=msgspec.convert({**rest, "width_px": width_px}, Camera),
        )
        for sequence, (at_ns, width_px) in enumerate(cameras)
    )


def test_the_keypoints_are_in_shares_of_the_camera_that_took_the_picture(playback: Playback) -> None:
    at_ns = with_hand(playback)
    use_cameras(playback, (playback.begin_ns, 640), (at_ns - 1_000_000_000, 1280), (at_ns + 1_000_000_000, 320))
    shares = moment(playback, at_ns).hand_share
    use_cameras(playback, (playback.begin_ns, 1280))
    wanted = moment(playback, at_ns).hand_share
    assert shares is not None
    assert wanted is not None
    assert shares.tolist() == wanted.tolist()


def test_pictures_that_were_cut_before_their_first_chunk_are_none(pictured: Path, tmp_path: Path) -> None:
    whole = pictures_path(pictured.parent, SESSION).read_bytes()
    for path in pictured.parent.iterdir():
        shutil.copy(path, tmp_path / path.name)
    pictures_path(tmp_path, SESSION).write_bytes(whole[:2000])
    with closing(Playback(tmp_path / pictured.name)) as opened:
        assert opened.pictures is None


def test_in_a_terminal_it_is_drawn_in_half_blocks(playback: Playback) -> None:
    lines = draw_picture(moment(playback, with_hand(playback)).picture_jpeg, 64, 20)
    assert len(lines) == 18  # 16:9 in cells of 1:2
    assert {text for line in lines for text, _ in line} == {"▀" * 64}
    assert draw_picture(b"no image", 64, 20)
    assert draw_picture(b"", 3, 1) == ()
