"""Recordings come back as they were, and cut or damaged ones are reported by name."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from hal.cameras.camera import Camera, EndOfRecording, Frame
from hal.cameras.factory import open_camera
from hal.cameras.playback import PlaybackCamera, folder_source
from hal.cameras.recording import INDEX, Recorder, recorded_source
from hal.errors import CameraFault, HardwareError, RecordingFault
from tests.hal.cameras.conftest import FRAMES, HEIGHT, PERIOD_NS, WIDTH, Kept, small_hand
from tests.support.errors import refused


def played(camera: Camera) -> tuple[list[Frame], bool]:
    """All frames, and whether the recording was cut off."""
    frames: list[Frame] = []
    camera.open()
    try:
        while True:
            frame = camera.read(1.0)
            assert frame is not None
            frames.append(frame)
    except EndOfRecording as end:
        return frames, end.cut_off
    finally:
        camera.close()


@pytest.fixture
def session(kept: Kept, tmp_path: Path) -> Path:
    return Path(shutil.copytree(kept.session, tmp_path / "session"))


def test_a_recorded_session_plays_back_images_depth_times_and_lens(kept: Kept) -> None:
    frames, cut_off = played(PlaybackCamera(kept.session, recorded_source(kept.session)))
    hand = small_hand()
    assert len(frames) == FRAMES
    assert not cut_off
    gaps = np.diff([frame.captured_ns for frame in frames])
    assert gaps == pytest.approx(PERIOD_NS, abs=2)
    for number, frame in enumerate(frames, 1):
        original = hand.render(number * PERIOD_NS)
        assert frame.intrinsics == original.intrinsics
        assert np.abs(frame.image_bgr.astype(int) - original.image_bgr).mean() < 3
        assert frame.depth_m is not None
        assert original.depth_m is not None
        assert np.abs(frame.depth_m - original.depth_m).max() < 1e-6


def test_images_in_a_folder_come_back_bit_for_bit(kept: Kept) -> None:
    frames, _ = played(PlaybackCamera(kept.folder, folder_source(kept.folder), paced=False))
    hand = small_hand()
    assert len(frames) == FRAMES
    for number, frame in enumerate(frames, 1):
        assert np.array_equal(frame.image_bgr, hand.render(number * PERIOD_NS).image_bgr)


def test_a_mirrored_camera_is_turned_back(kept: Kept) -> None:
    plain, _ = played(PlaybackCamera(kept.session, recorded_source(kept.session), paced=False))
    turned, _ = played(PlaybackCamera(kept.session, recorded_source(kept.session), paced=False, mirrored=True))
    assert np.array_equal(turned[0].image_bgr, plain[0].image_bgr[:, ::-1])
    assert turned[0].depth_m is not None
    assert plain[0].depth_m is not None
    assert np.array_equal(turned[0].depth_m, plain[0].depth_m[:, ::-1])


@pytest.mark.parametrize("keep", [2, 4, FRAMES + 1])
def test_a_session_cut_between_lines_plays_what_is_there_and_reports_that_it_is_cut(session: Path, keep: int) -> None:
    lines = (session / INDEX).read_text().splitlines()
    (session / INDEX).write_text("\n".join(lines[:keep]) + "\n")
    frames, cut_off = played(open_camera("recording", device=str(session)))
    assert len(frames) == keep - 1
    assert cut_off


def test_a_session_cut_within_a_line_or_an_image_ends_there(session: Path) -> None:
    text = (session / INDEX).read_text()
    (session / INDEX).write_text(text[: len(text) // 2])
    frames, cut_off = played(open_camera("recording", device=str(session)))
    assert 0 < len(frames) < FRAMES
    assert cut_off
    (session / "000001.jpg").write_bytes(b"\xff\xd8")
    frames, cut_off = played(open_camera("recording", device=str(session)))
    assert len(frames) == 1
    assert cut_off


@pytest.mark.parametrize(
    "header",
    [
        "",
        "garbage\n",
        '{"format": "other"}\n',
        '{"format": "rleex-recording", "version": 2}\n',
        '{"format": "rleex-recording", "version": 1, "intrinsics": {"fx_px": 1}}\n',
        '{"format": "rleex-recording", "version": 1, "intrinsics": 7}\n',
    ],
)
def test_an_index_without_a_usable_header_is_refused(session: Path, header: str) -> None:
    (session / INDEX).write_text(header)
    with pytest.raises(HardwareError) as caught:
        open_camera("recording", device=str(session)).open()
    assert caught.value.code in (RecordingFault.OTHER_VERSION, RecordingFault.NO_INTRINSICS)


def test_missing_empty_and_damaged_sources_are_refused_by_name(tmp_path: Path) -> None:
    with refused(RecordingFault.NOT_FOUND, path=tmp_path / "nothing.avi"):
        open_camera("recording", device=str(tmp_path / "nothing.avi"))
    with refused(RecordingFault.NOT_NAMED):
        open_camera("recording")
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


def test_a_realsense_recording_cut_in_half_is_refused_by_name(kept: Kept, tmp_path: Path) -> None:
    half = tmp_path / "half.bag"
    half.write_bytes(b"#ROSBAG V2.0\n" + kept.realsense.read_bytes()[:1000])
    camera = open_camera("realsense", device=str(half))
    with refused(CameraFault.REALSENSE_NOT_STARTED, camera="half.bag"):
        camera.open()
    with refused(RecordingFault.NOT_FOUND, path=tmp_path / "none.bag"):
        open_camera("realsense", device=str(tmp_path / "none.bag")).open()


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_a_recording_by_librealsense_that_was_cut_is_refused_by_name(kept: Kept, tmp_path: Path, share: float) -> None:
    whole = kept.realsense.read_bytes()
    cut = tmp_path / "cut.db3"
    cut.write_bytes(whole[: int(share * len(whole))])
    with refused(CameraFault.REALSENSE_NOT_STARTED, camera="cut.db3"):
        open_camera("realsense", device=str(cut)).open()


def test_images_of_another_size_than_the_first_are_refused(kept: Kept, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(kept.folder, tmp_path / "mixed"))
    import cv2

    cv2.imwrite(str(folder / "002.png"), np.zeros((HEIGHT // 2, WIDTH // 2, 3), np.uint8))
    camera = open_camera("recording", device=str(folder))
    camera.open()
    assert camera.read(1.0) is not None
    with refused(CameraFault.OTHER_RESOLUTION, width_px=WIDTH, image_width_px=WIDTH // 2):
        camera.read(1.0)


def test_a_recorder_never_overwrites_and_reports_what_it_wrote(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "new", "hand")
    recorder.write(small_hand().render(PERIOD_NS))
    recorder.close()
    assert (recorder.written, recorder.dropped, recorder.fault) == (1, 0, None)
    last = json.loads((tmp_path / "new" / INDEX).read_text().splitlines()[-1])
    assert last == {"end": True, "frames": 1, "dropped": 0}
    with refused(RecordingFault.UNWRITABLE, path=tmp_path / "new"):
        Recorder(tmp_path / "new", "hand")


def test_a_full_disk_ends_the_recording_and_not_the_program(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "full", "hand")
    (tmp_path / "full" / "000000.jpg").mkdir()  # the first image can't be written
    recorder.write(small_hand().render(PERIOD_NS))
    recorder.close()
    assert recorder.fault is not None
    assert recorder.fault.code is RecordingFault.ENDED_EARLY
    assert recorder.written == 0
