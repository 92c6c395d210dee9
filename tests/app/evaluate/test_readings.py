from __future__ import annotations

import re
import resource
import struct
import zlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from app.evaluate.harness import EvaluateFault
from app.evaluate.readings import (
    DISTANCE_COLUMNS,
    GESTURE_COLUMNS,
    LabelledImage,
    read_footage,
    read_frames,
    read_image,
)
from app.system.errors import AppError
from app.text.catalogue import render
from hal.cameras.playback import MAX_PIXELS, pixels_of, video_source
from kgdfa.preprocess import as_bgr8
from logs.reason import Reason


def filmed(file: Path, codec: str, images: Iterable[NDArray[np.uint8]]) -> Path:
    """A video of images of 64×48, 20 a second."""
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*codec), 20.0, (64, 48))
    for image in images:
        writer.write(image)
    writer.release()
    return file


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve frames of 64×48 at 20 a second, each lighter than the last."""
    images = (np.full((48, 64, 3), 20 * number, np.uint8) for number in range(12))
    return filmed(tmp_path_factory.mktemp("footage") / "hand.avi", "MJPG", images)


def test_a_video_has_a_label_for_every_frame(video: Path, tmp_path: Path) -> None:
    table = tmp_path / "labels.csv"
    table.write_text("frame,label\n0,skip\n3,5\n10,none:rest\n")
    footage = read_footage(video, table)
    assert footage.labels == ("skip",) * 3 + ("5",) * 7 + ("none:rest",) * 2
    assert footage.period_ns == 50_000_000
    assert footage.focal_px == pytest.approx(47.5)
    for _ in range(2):
        lightness = [image.mean() for image in footage.frames() if image is not None]
        assert lightness == pytest.approx([20 * number for number in range(12)], abs=6)


def test_a_cut_video_is_read_as_far_as_it_goes_beside_what_its_header_claims(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).integers(0, 256, (40, 48, 64, 3), np.uint8)
    cut = filmed(tmp_path / "cut.avi", "MJPG", noise)
    data = cut.read_bytes()
    cut.write_bytes(data[: len(data) // 2])
    cut.with_suffix(".csv").write_text("frame,label\n0,5\n")
    footage = read_footage(cut)
    assert footage.claimed_frames == 40
    assert 10 < len(footage.labels) == len([*footage.frames()]) < 30


def test_a_rate_that_no_camera_has_is_not_taken(tmp_path: Path) -> None:
    file = filmed(tmp_path / "fast.mp4", "mp4v", [np.zeros((48, 64, 3), np.uint8)] * 3)
    data = bytearray(file.read_bytes())
    scale = data.index(b"mdhd") + 16  # of time, behind version and two dates
    data[scale : scale + 4] = (int.from_bytes(data[scale : scale + 4]) * 1000).to_bytes(4)
    file.write_bytes(data)
    file.with_suffix(".csv").write_text("frame,label\n0,5\n")
    assert read_footage(file).period_ns == 33_333_333


def with_slow_end(file: Path, frames: int, slow: int) -> Path:
    """A telephone's video: its second part's frames last thrice as long. ISO 14496-12, 8.6.1.2: the table `stts`."""
    data = file.read_bytes()
    at, begins, end = list[int](), 0, len(data)
    for name in (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stts"):
        place = data.index(name, begins, end) - 4
        begins, end = place + 8, place + int.from_bytes(data[place : place + 4])
        at.append(place)
    (delta,) = struct.unpack(">I", data[at[-1] + 20 : at[-1] + 24])
    table = struct.pack(">I4s6I", 32, b"stts", 0, 2, frames - slow, delta, slow, 3 * delta)
    longer = bytearray(data)
    for place in at[:-1]:
        size = int.from_bytes(data[place : place + 4]) + len(table) - (end - at[-1])
        longer[place : place + 4] = size.to_bytes(4)
    longer[at[-1] : end] = table
    file.write_bytes(longer)
    return file


def test_a_video_is_played_by_its_frames_own_times(tmp_path: Path) -> None:
    file = filmed(tmp_path / "phone.mp4", "mp4v", [np.full((48, 64, 3), 10 * n, np.uint8) for n in range(12)])
    with_slow_end(file, 12, 6)
    offsets_ms = [round(frame.offset_ns / 1e6) for frame in video_source(file)()]
    assert offsets_ms == [0, 50, 100, 150, 200, 250, 300, 450]  # its length in the header is still the old one
    file.with_suffix(".csv").write_text("frame,label\n0,5\n")
    assert read_footage(file).period_ns == pytest.approx(450_000_000 / 7, abs=1)


def stamped(file: Path, stamps_ms: Sequence[int]) -> Path:
    """A browser's video: Matroska (RFC 9559) whose images, of one cluster, have these times and no rate."""
    data = bytearray(file.read_bytes())
    rate = data.index(b"\x23\xe3\x83\x84")  # DefaultDuration, of four bytes
    data[rate : rate + 8] = b"\xec\x86" + bytes(6)  # Void
    blocks = re.finditer(rb"\xa3(?:[\x81-\xff]|[\x40-\x7f].)\x81(..)[\x00\x80]", bytes(data), re.DOTALL)
    for block, stamp_ms in zip(blocks, stamps_ms, strict=True):
        data[slice(*block.span(1))] = stamp_ms.to_bytes(2)
    file.write_bytes(data)
    return file


def test_two_images_at_one_time_change_no_later_time(tmp_path: Path) -> None:
    file = filmed(tmp_path / "browser.webm", "VP80", [np.full((48, 64, 3), 5 * n, np.uint8) for n in range(40)])
    stamps_ms = [16 * number for number in range(40)]
    stamps_ms[9] = stamps_ms[8] + 1
    stamped(file, stamps_ms)
    offsets_ms = [round(frame.offset_ns / 1e6) for frame in video_source(file)()]
    assert offsets_ms == [*stamps_ms[:9], stamps_ms[8] + 16, *stamps_ms[10:]]


def test_a_name_with_a_colon_is_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    named = Path("2026-11-27T10:30.mp4")
    filmed(tmp_path / named, "mp4v", [np.zeros((48, 64, 3), np.uint8)] * 3)
    named.with_suffix(".csv").write_text("frame,label\n0,5\n")
    assert len([*read_footage(named).frames()]) == len([*video_source(named)()]) == 3


def test_an_image_of_a_folder_that_can_not_be_read_leaves_the_others(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((40, 40, 3), np.uint8))
    rows = "".join(f"{name},1,6.7,900\n" for name in ("a.png", "gone.png", "a.png"))
    (tmp_path / "frames.csv").write_text("path,label,anchor_cm,fx\n" + rows)
    footage = read_footage(tmp_path)
    missing = [path.name for path, image in zip(footage.paths, footage.frames(), strict=True) if image is None]
    assert missing == ["gone.png"]


def test_a_photo_is_read_the_way_up_that_its_camera_noted(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x112] = 6  # turn it right by a quarter to see it upright
    Image.new("RGB", (30, 20)).save(tmp_path / "a.jpg", exif=exif)
    image = read_image(LabelledImage(path="a.jpg", label="5"), tmp_path)
    assert isinstance(image, np.ndarray)
    assert image.shape == (30, 20, 3)


@pytest.mark.parametrize(
    "kept",
    [
        np.arange(48, dtype=np.uint8).reshape(6, 8),
        np.arange(144, dtype=np.uint8).reshape(6, 8, 3),
        np.arange(192, dtype=np.uint8).reshape(6, 8, 4),
        np.arange(48, dtype=np.uint16).reshape(6, 8) * 1000,
        np.arange(192, dtype=np.uint16).reshape(6, 8, 4) * 300,
    ],
    ids=["grey", "colour", "alpha", "grey of 16 bit", "alpha of 16 bit"],
)
def test_every_kind_of_image_is_read_as_it_was_kept(tmp_path: Path, kept: NDArray[np.integer[Any]]) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), kept)
    image = read_image(LabelledImage(path="a.png", label="5"), tmp_path)
    assert isinstance(image, np.ndarray)
    assert np.array_equal(image, as_bgr8(kept))


MUCH_TEXT = PngInfo()
MUCH_TEXT.add_text("a", "x" * (2 << 20), zip=True)


@pytest.mark.parametrize(
    "beside", [{"pnginfo": MUCH_TEXT}, {"icc_profile": bytes(2 << 20)}], ids=["text", "colour profile"]
)
def test_a_png_with_much_beside_its_pixels_is_an_image(tmp_path: Path, beside: dict[str, Any]) -> None:
    Image.new("RGB", (30, 20), (1, 2, 3)).save(tmp_path / "a.png", **beside)
    image = read_image(LabelledImage(path="a.png", label="5"), tmp_path)
    assert isinstance(image, np.ndarray)
    assert image.tolist() == [[[3, 2, 1]] * 30] * 20


@pytest.mark.parametrize("name", ["zTXt", "iCCP"])
def test_what_is_packed_beside_a_pngs_pixels_takes_no_memory(tmp_path: Path, name: str) -> None:
    packer, packed = zlib.compressobj(9), b"a\0\0"
    for _ in range(1 << 10):
        packed += packer.compress(bytes(1 << 20))
    packed += packer.flush()
    Image.new("RGB", (30, 20)).save(tmp_path / "plain.png")
    plain, body = (tmp_path / "plain.png").read_bytes(), name.encode() + packed
    chunk = struct.pack(">I", len(packed)) + body + struct.pack(">I", zlib.crc32(body))
    (tmp_path / "a.png").write_bytes(plain[:33] + chunk + plain[33:])  # behind the header
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert isinstance(read_image(LabelledImage(path="a.png", label="5"), tmp_path), np.ndarray)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 100_000, "a gigabyte is packed"


@pytest.mark.parametrize("size", [(100_000, 100_000), (MAX_PIXELS + 1, 1), (0, 0)])
def test_a_png_is_refused_by_the_size_that_it_claims(tmp_path: Path, size: tuple[int, int]) -> None:
    Image.new("RGB", (30, 20)).save(tmp_path / "a.png")
    data = bytearray((tmp_path / "a.png").read_bytes())
    data[16:24] = struct.pack(">II", *size)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    (tmp_path / "a.png").write_bytes(data)
    assert isinstance(read_image(LabelledImage(path="a.png", label="5"), tmp_path), Reason)
    assert pixels_of(bytes(data)) == size[0] * size[1]
    assert pixels_of(bytes(data[:18])) == 0


def test_the_table_beside_the_video_is_its_own(video: Path) -> None:
    video.with_suffix(".csv").write_text("frame,label\n0,love\n")
    assert read_footage(video).labels == ("love",) * 12


@pytest.mark.parametrize(
    ("text", "fault", "line"),
    [
        ("", EvaluateFault.TABLE_COLUMNS, None),
        ("path,label\n", EvaluateFault.TABLE_COLUMNS, None),
        ("frame,label\n", EvaluateFault.VIDEO_START, None),
        ("frame,label\n1,5\n", EvaluateFault.VIDEO_START, None),
        ("frame,label\n0,5\n-4,skip\n", EvaluateFault.VIDEO_ROW, 3),
        ("frame,label\n0,5\n4\n", EvaluateFault.ROW_FIELDS, 3),
        ("frame,label\n0,5\n4,eleven\n", EvaluateFault.ROW_LABEL, 3),
        ("frame,label\n0,5\n4,skip\n4,6\n", EvaluateFault.VIDEO_ORDER, 4),
        ("frame,label\n0,5\n4,skip\n12,6\n", EvaluateFault.VIDEO_ORDER, 4),
    ],
)
def test_bad_tables_are_refused_by_line(
    video: Path, tmp_path: Path, text: str, fault: EvaluateFault, line: int | None
) -> None:
    table = tmp_path / "labels.csv"
    table.write_text(text)
    with pytest.raises(AppError) as caught:
        read_footage(video, table)
    assert (caught.value.code, caught.value.values.get("line")) == (fault, line)
    assert str(table) in render(caught.value)


def test_what_is_no_footage_is_refused(video: Path, tmp_path: Path) -> None:
    (tmp_path / "text.mp4").write_text("no video")
    refused = [
        (tmp_path / "missing.mp4", None, EvaluateFault.VIDEO_UNREADABLE),
        (tmp_path / "text.mp4", None, EvaluateFault.VIDEO_UNREADABLE),
        (video, tmp_path / "missing.csv", EvaluateFault.FILE_UNREADABLE),
        (tmp_path, tmp_path / "labels.csv", EvaluateFault.LABELS_OPTION),
    ]
    for where, labels, fault in refused:
        with pytest.raises(AppError) as caught:
            read_footage(where, labels)
        assert caught.value.code is fault


HEADER = "path,label,distance_cm,anchor_cm,fx,fy,cx,cy\n"


@pytest.mark.parametrize(
    ("text", "columns", "fault", "line"),
    [
        (HEADER, GESTURE_COLUMNS, EvaluateFault.TABLE_EMPTY, None),
        (HEADER + "a.jpg,1,40,6.7,wide,900,1,1\n", GESTURE_COLUMNS, EvaluateFault.ROW_NUMBER, 2),
        (
            HEADER + "a.jpg,1,40,6.7,900,900,1,1\nb.jpg,ten,40,6.7,900,900,1,1\n",
            GESTURE_COLUMNS,
            EvaluateFault.ROW_LABEL,
            3,
        ),
        ("path,label\na.jpg,1\n", GESTURE_COLUMNS, EvaluateFault.TABLE_COLUMNS, None),
        (HEADER + "a.jpg,1,0,6.7,900,900,1,1\n", DISTANCE_COLUMNS, EvaluateFault.ROW_DISTANCE, 2),
        (HEADER + "a.jpg,1,nan,6.7,900,900,1,1\n", DISTANCE_COLUMNS, EvaluateFault.ROW_DISTANCE, 2),
    ],
)
def test_bad_frame_lists_are_refused_by_line(
    tmp_path: Path, text: str, columns: tuple[str, ...], fault: EvaluateFault, line: int | None
) -> None:
    (tmp_path / "frames.csv").write_text(text)
    with pytest.raises(AppError) as caught:
        read_frames(tmp_path, columns)
    assert (caught.value.code, caught.value.values.get("line")) == (fault, line)


def test_one_reader_gives_labels_and_distances_whichever_are_required(tmp_path: Path) -> None:
    (tmp_path / "frames.csv").write_text(HEADER + "a.jpg,love,40,6.7,900,901,640,360\n")
    (labelled,) = read_frames(tmp_path)
    assert (labelled.label, labelled.reference_m, labelled.focal_px) == ("love", 0.067, 900.0)
    (measured,) = read_frames(tmp_path, DISTANCE_COLUMNS)
    assert (measured.distance_m, measured.centre_px) == (0.40, (640.0, 360.0))
