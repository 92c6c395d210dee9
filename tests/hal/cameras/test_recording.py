"""Images and videos come back as they were, and cut or damaged ones are reported by name."""

from __future__ import annotations

import errno
import shutil
from collections.abc import Iterator
from contextlib import closing, nullcontext, suppress
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from hal.cameras import playback
from hal.cameras.camera import Camera, EndOfRecording, Frame
from hal.cameras.factory import open_camera
from hal.cameras.playback import PlaybackCamera, RecordedFrame, folder_source, image_files, video_source
from hal.errors import CameraFault, RecordingFault
from tests.hal.cameras.conftest import FRAMES, HEIGHT, PERIOD_NS, WIDTH, Kept, small_hand
from tests.support.errors import refused


def played(camera: Camera) -> list[Frame]:
    """All frames."""
    frames: list[Frame] = []
    camera.open()
    try:
        while True:
            frame = camera.read(1.0)
            assert frame is not None
            frames.append(frame)
    except EndOfRecording:
        return frames
    finally:
        camera.close()


def test_images_in_a_folder_come_back_bit_for_bit(kept: Kept) -> None:
    frames = played(PlaybackCamera(kept.folder, folder_source(kept.folder), paced=False))
    hand = small_hand()
    assert len(frames) == FRAMES
    for number, frame in enumerate(frames, 1):
        assert np.array_equal(frame.image_bgr, hand.render(number * PERIOD_NS).image_bgr)


def test_a_mirrored_camera_is_turned_back(kept: Kept) -> None:
    plain = played(PlaybackCamera(kept.folder, folder_source(kept.folder), paced=False))
    turned = played(PlaybackCamera(kept.folder, folder_source(kept.folder), paced=False, mirrored=True))
    assert np.array_equal(turned[0].image_bgr, plain[0].image_bgr[:, ::-1])


def test_missing_empty_and_damaged_sources_are_refused_by_name(tmp_path: Path) -> None:
    with refused(RecordingFault.NOT_FOUND, path=tmp_path / "nothing.avi"):
        open_camera("recording", device=str(tmp_path / "nothing.avi")).open()
    with refused(RecordingFault.NOT_FOUND, path=Path("~nobody-here/a.avi")):
        open_camera("recording", device="~nobody-here/a.avi").open()
    with refused(RecordingFault.NOT_NAMED):
        open_camera("recording").open()
    (tmp_path / "empty").mkdir()
    with refused(RecordingFault.FOLDER_EMPTY, path=tmp_path / "empty"):
        open_camera("recording", device=str(tmp_path / "empty")).open()
    broken = tmp_path / "broken.mp4"
    broken.write_bytes(b"\x00" * 2000)
    with refused(RecordingFault.VIDEO_UNREADABLE, path=broken):
        open_camera("recording", device=str(broken)).open()
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    (pictures / "a.png").write_bytes(b"no picture")
    with refused(RecordingFault.IMAGE_UNREADABLE, path=pictures / "a.png"):
        open_camera("recording", device=str(pictures)).open()


@pytest.mark.parametrize("name", ["x" * 300, "a/" * 3000 + "b", "a\0b"], ids=["name", "path", "NUL"])
def test_a_name_that_no_file_can_have_is_not_found(name: str) -> None:
    with refused(RecordingFault.NOT_FOUND):
        open_camera("recording", device=name).open()
    with refused(RecordingFault.NOT_FOUND):
        open_camera("realsense", device=f"{name}.bag").open()
    with refused(RecordingFault.VIDEO_UNREADABLE):
        next(video_source(Path(name))())
    with refused(RecordingFault.FOLDER_NOT_FOUND):
        image_files(Path(name))


def test_a_folder_that_may_not_be_read_is_refused_by_name(kept: Kept, monkeypatch: pytest.MonkeyPatch) -> None:
    def locked(_: Path) -> Iterator[Path]:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", locked)
    with refused(RecordingFault.FOLDER_UNREADABLE, path=kept.folder):
        open_camera("recording", device=str(kept.folder)).open()


def test_a_realsense_recording_cut_in_half_is_refused_by_name(kept: Kept, tmp_path: Path) -> None:
    half = tmp_path / "half.bag"
    half.write_bytes(b"#ROSBAG V2.0\n" + kept.realsense.read_bytes()[:1000])
    camera = open_camera("realsense", device=str(half))
    with refused(CameraFault.REALSENSE_RECORDING_DAMAGED, camera="half.bag"):
        camera.open()
    with refused(RecordingFault.NOT_FOUND, path=tmp_path / "none.bag"):
        open_camera("realsense", device=str(tmp_path / "none.bag")).open()


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_a_recording_by_librealsense_that_was_cut_is_refused_by_name(kept: Kept, tmp_path: Path, share: float) -> None:
    whole = kept.realsense.read_bytes()
    cut = tmp_path / "cut.db3"
    cut.write_bytes(whole[: int(share * len(whole))])
    with refused(CameraFault.REALSENSE_RECORDING_DAMAGED, camera="cut.db3"):
        open_camera("realsense", device=str(cut)).open()


def test_images_of_another_size_than_the_first_are_refused(kept: Kept, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(kept.folder, tmp_path / "mixed"))
    import cv2

    for path in sorted(folder.iterdir())[1:]:
        cv2.imwrite(str(path), np.zeros((HEIGHT // 2, WIDTH // 2, 3), np.uint8))
    camera = PlaybackCamera(folder, folder_source(folder), paced=False)
    camera.open()
    assert camera.read(1.0) is not None
    with refused(CameraFault.OTHER_RESOLUTION, width_px=WIDTH, image_width_px=WIDTH // 2):
        camera.read(1.0)


@pytest.mark.parametrize(("times", "refuses"), [(2, True), (1, False)])
def test_a_focal_length_that_is_given_for_another_size_than_the_recordings_is_refused(
    kept: Kept, times: int, refuses: bool
) -> None:
    """Every distance would be wrong by the ratio of the sizes."""
    size = {"width_px": times * WIDTH, "height_px": times * HEIGHT}
    camera = open_camera("recording", device=str(kept.folder), focal_px=950.0, **size)
    stated = {**size, "image_width_px": WIDTH, "image_height_px": HEIGHT}
    with closing(camera), refused(CameraFault.FOCAL_LENGTH_OTHER_SIZE, **stated) if refuses else nullcontext():
        camera.open()
        frame = camera.read(1.0)
        assert frame is not None
        assert (frame.intrinsics.fx_px, frame.intrinsics.width_px) == (950.0, WIDTH)


class Clock:
    """In place of `time`."""

    def __init__(self) -> None:
        self.now_ns = 0

    def monotonic_ns(self) -> int:
        return self.now_ns

    def sleep(self, seconds: float) -> None:
        self.now_ns += round(seconds * 1e9)


@pytest.mark.parametrize(("paced", "given"), [(True, 8), (False, 29)])
def test_a_reader_slower_than_the_recording_gets_the_newest_image_if_paced(
    monkeypatch: pytest.MonkeyPatch, paced: bool, given: int
) -> None:
    clock = Clock()
    monkeypatch.setattr(playback, "time", clock)

    def source() -> Iterator[RecordedFrame]:
        grey = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        return (RecordedFrame(offset_ns=number * PERIOD_NS, image_bgr=grey) for number in range(29))

    camera = PlaybackCamera(Path("one.avi"), source, paced=paced)
    camera.open()
    ages_ns = list[int]()
    with suppress(EndOfRecording):
        while frame := camera.read(1.0):
            ages_ns.append(clock.now_ns - frame.captured_ns)
            clock.sleep(4 * PERIOD_NS / 1e9)
    assert len(ages_ns) == given
    assert not paced or max(ages_ns) < 2 * PERIOD_NS


def test_a_folders_images_come_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    names = [f"frame_{number}.png" for number in (1, 2, 9, 10, 11, 100)]
    for name in reversed(names):
        cv2.imwrite(str(tmp_path / name), np.zeros((4, 4, 3), np.uint8))
    assert [path.name for path in image_files(tmp_path)] == names


@pytest.mark.parametrize("decoding", [0.5, 0.99, 1.2, 4.0])  # in periods of the video
def test_a_video_that_decodes_slower_than_its_rate_plays_slower_and_stays_live(
    monkeypatch: pytest.MonkeyPatch, decoding: float
) -> None:
    clock = Clock()
    monkeypatch.setattr(playback, "time", clock)

    def source() -> Iterator[RecordedFrame]:
        grey = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        for number in range(300):
            clock.sleep(decoding * PERIOD_NS / 1e9)
            yield RecordedFrame(offset_ns=number * PERIOD_NS, image_bgr=grey)

    camera = PlaybackCamera(Path("one.avi"), source)
    camera.open()
    captures_ns, ages_ns = list[int](), list[int]()
    with suppress(EndOfRecording):
        while frame := camera.read(0.1):
            clock.sleep(0.9 * PERIOD_NS / 1e9)
            captures_ns.append(frame.captured_ns)
            ages_ns.append(clock.now_ns - frame.captured_ns)
    assert len(captures_ns) > 50
    assert all(before < after for before, after in pairwise(captures_ns))
    assert max(ages_ns) < 250_000_000
