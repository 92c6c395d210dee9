"""Bad input at every reader: a coded refusal, in time, and nothing written."""

from __future__ import annotations

import re
import shutil
import struct
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.console.review_data import open_session
from app.console.session_index import Records, SessionRecord
from app.evaluate.gestures.images import load_hands
from app.evaluate.loop.rehearsal import read_norm
from app.evaluate.readings import read_footage, read_frames, read_labels
from app.system.config import load_config
from app.system.errors import AppError
from app.system.operators import load_store
from app.text.catalogue import render, use_language
from hal.cameras.factory import open_camera
from hal.cameras.intrinsics import assumed
from hal.cameras.intrinsics import load as load_intrinsics
from hal.cameras.intrinsics import save as save_intrinsics
from hal.cameras.playback import read_image
from hal.joints.can.candump import open_log
from hal.joints.device import DEFAULT_DEVICE, load_exoskeleton
from hal.joints.motors import BUILT_IN_TABLE, load_motors
from kgdfa.robust import load_model
from logs.keys import load_public_key, read_anchors
from logs.query import connect_locked
from logs.read import records
from logs.reading.errors import CodedError, InputError, InputFault
from logs.reading.formats import MAX_TOML, decode_json, parse_toml, read_json_lines
from logs.reading.regular import read_bytes
from profiles.files import decode, encode, read_text
from profiles.schema import DEMO_PATIENT
from profiles.store import ProfileStore
from tests.support.bad_input import NODES, in_time

ROOT = Path(__file__).parents[1]
SCHEMA1 = ROOT / "tests/logs/data/schema1"


def _history(path: Path) -> object:
    return ProfileStore(path.parent.parent).history("x")


# Reader → (the name its file has, what opens it).
READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "configuration": ("config.toml", load_config),
    "device": ("device.toml", load_exoskeleton),
    "motors": ("motors.toml", load_motors.__wrapped__),
    "intrinsics": ("cameras.toml", lambda path: load_intrinsics(path, "camera")),
    "profile": ("x.toml", lambda path: decode(read_text(path), str(path))),
    "profile history": ("history/x.jsonl", _history),
    "operators": ("operators.json", lambda path: load_store(path.parent)),
    "anchor": ("history.json", lambda path: read_anchors(path.parent)),
    "journal's end": ("ends/changes.jsonl.json", lambda path: read_anchors(path.parent.parent)),
    "public key": ("console.pub", load_public_key),
    "session index": ("x.jsonl", lambda path: Records(path.parent, SessionRecord).of("x")),
    "trail": ("trail.jsonl", records),
    "review": ("trail.jsonl", open_session),
    "query": ("trail.jsonl", lambda path: connect_locked([path])),
    "labels": ("labels.csv", lambda path: read_labels(path.parent)),
    "frames": ("frames.csv", read_frames),
    "gait norm": ("gait_norm.csv", lambda path: read_norm(path.parent)),
    "footage": ("film.mp4", read_footage),
    "video": ("film.mp4", lambda path: open_camera("recording", device=str(path)).open()),
    "image": ("a.png", read_image),
    "keypoints": ("hands.npz", lambda path: load_hands(path, [])),
    "gesture model": ("robust.npz", load_model),
    "bus log": ("bus.log", lambda path: open_log(path).close()),
}
# Readers that judge line by line what they hold: a bad line is shown as one or left out, not refused.
TOLERANT = {"trail", "review", "query", "bus log"}

CONTENTS: dict[str, bytes] = {
    "UTF-16": 'language = "en"\n'.encode("utf-16"),
    "Latin-1": b'language = "\xe9\xff"\n',
    "NUL": b"a = 1\0\n",
    "escaped NUL": b'model = "a\\u0000b"\n',
    "integer of 400 digits": b"idle_lock_s = " + b"9" * 400 + b"\n",
    "integer of 5000 digits": b"stature_cm = " + b"9" * 5000 + b"\n",
    "inf": b"idle_lock_s = inf\n",
    "nan": b"idle_lock_s = nan\n",
    "1e400": b"idle_lock_s = 1e400\n",
    "nested TOML": b"a = " + b"[" * 50_000 + b"]" * 50_000,
    "nested tables": b"a = " + b"{b = " * 5_000 + b"1" + b"}" * 5_000,
    "dotted key": b".".join([b"a"] * 60_000) + b" = 1\n",
    "nested JSON": b"[" * 200_000,
    "nested objects": b'{"a":' * 100_000,
    "JSON 1e400": b'{"format": "rleex-recording", "version": 1e400}\n',
    "JSON NaN": b'{"captured_ns": NaN}\n',
    "zeros": bytes(100_000),
    "escapes": b"\x1b[2J\x1b]0;x\x07 = 1\n",
    "half a PNG": b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR\xff\xff\xff\xff\xff\xff\xff\xff",
    "zip of nothing": b"PK\x05\x06" + bytes(18),
}


def worded(error: Exception) -> Exception:
    """The error, which has text in both languages."""
    for language in ("zh", "en"):
        use_language(language)
        assert render(error)
    return error


def opened(path: Path, read: Callable[[Path], object]) -> Exception | None:
    """The refusal of a reader, worded in both languages; None when it took the file. All else fails the test."""
    before = sorted(path.parent.rglob("*"))
    with in_time():
        try:
            read(path)
        except (CodedError, InputError) as error:
            return worded(error)
        finally:
            assert sorted(path.parent.rglob("*")) == before
    return None


def place(folder: Path, name: str) -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


@pytest.mark.parametrize("content", CONTENTS)
@pytest.mark.parametrize("reader", READERS)
def test_bad_content_is_refused(tmp_path: Path, reader: str, content: str) -> None:
    name, read = READERS[reader]
    path = place(tmp_path, name)
    path.write_bytes(CONTENTS[content])
    assert opened(path, read) is not None or reader in TOLERANT


# A link to itself does not exist for what may be missing; the others are refused as what they are.
@pytest.mark.parametrize("node", NODES)
@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_regular_file_is_refused(tmp_path: Path, reader: str, node: str) -> None:
    name, read = READERS[reader]
    path = place(tmp_path, name)
    NODES[node](path)
    assert opened(path, read) is not None or node == "itself"


@cache
def _valid() -> dict[str, bytes]:
    """A valid file of most kinds."""
    with TemporaryDirectory() as folder:
        cameras = Path(folder) / "cameras.toml"
        save_intrinsics(cameras, "camera", assumed(1280, 720), 0.2, print)
        intrinsics = cameras.read_bytes()
    return {
        "configuration": b'language = "zh"\n[camera]\nkind = "webcam"\nrate_hz = 30.0\n[keys]\nstop = "s"\n',
        "device": DEFAULT_DEVICE.read_bytes(),
        "motors": BUILT_IN_TABLE.read_bytes(),
        "intrinsics": intrinsics,
        "profile": encode(DEMO_PATIENT).encode(),
        "profile history": b'{"at":"2026","by":"x","changes":{"a":[1,2.5]},"why":""}\n',
        "session index": b'{"session":"a","patient":"x","at":"2026","steps":3}\n',
        "trail": (SCHEMA1 / "logs/whole.jsonl").read_bytes()[:20_000],
        "review": (SCHEMA1 / "logs/whole.jsonl").read_bytes()[:20_000],
        "public key": (SCHEMA1 / "keys/console.pub").read_bytes(),
        "anchor": (SCHEMA1 / "keys/history.json").read_bytes(),
        "labels": b"path,label,source,group\na.jpg,1,s,g\n",
        "frames": b"path,label,fx,anchor_cm\na.jpg,1,900,6.7\n",
        "gesture model": (ROOT / "kgdfa/robust.npz").read_bytes(),
    }


@pytest.mark.parametrize("reader", sorted(READERS))
@given(data=st.data())
@settings(max_examples=25)
def test_random_and_mutated_files_end_in_a_code(
    tmp_path_factory: pytest.TempPathFactory, reader: str, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("mutated")
    try:
        content = _valid().get(reader, b"")
        if content and data.draw(st.booleans()):
            at = data.draw(st.integers(0, len(content)))
            gone = data.draw(st.integers(0, 40))
            content = content[:at] + data.draw(st.binary(max_size=20)) + content[at + gone :]
        else:
            content = data.draw(st.binary(max_size=300))
        name, read = READERS[reader]
        path = place(folder, name)
        path.write_bytes(content)
        opened(path, read)
    finally:
        shutil.rmtree(folder)


@given(st.text(max_size=200))
def test_any_text_as_toml_or_json_ends_in_a_code(text: str) -> None:
    for parse in (parse_toml, lambda one: decode_json(one.encode("utf-8", "surrogatepass"), object)):
        try:
            parse(text)
        except InputError as error:
            worded(error)


def test_sizes_are_limited_and_a_byte_order_mark_is_none_of_the_text(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_bytes(b"#" * (MAX_TOML + 1))
    with pytest.raises(AppError) as caught:
        load_config(path)
    detail = caught.value.values["detail"]
    assert isinstance(detail, InputError)
    assert detail.code is InputFault.TOO_LARGE
    path.write_bytes(b'\xef\xbb\xbflanguage = "zh"\r\n')
    assert load_config(path).language == "zh"
    with pytest.raises(InputError):
        read_bytes(Path("/proc/self/maps"), 10)  # a regular file that says it has no size
    path.write_bytes(b"{}\n\n[]\n")
    assert read_json_lines(path, object) == ({}, [])


def _claiming(suffix: str, width: int, height: int) -> bytes:
    """A small image whose header claims another size."""
    _, encoded = cv2.imencode(suffix, np.zeros((8, 8, 3), np.uint8))
    data = bytearray(encoded.tobytes())
    if suffix == ".png":
        data[16:24] = struct.pack(">II", width, height)
        data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    elif suffix == ".bmp":
        data[18:26] = struct.pack("<ii", width, height)
    else:
        start = data.index(b"\xff\xc0") + 5
        data[start : start + 4] = struct.pack(">HH", height, width)
    return bytes(data)


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".jpg"])
def test_a_huge_image_is_refused_before_it_is_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(_claiming(suffix, 8, 8))
    assert read_image(path).shape == (8, 8, 3)
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("decoded"))
    path.write_bytes(_claiming(suffix, 30_000, 30_000))
    assert opened(path, read_image) is not None


@pytest.mark.parametrize("value", ["9" * 400, "-" + "9" * 30, "1e308", "-1", "0"])
@pytest.mark.parametrize("reader", sorted({*READERS} - {"gesture model", "public key"}))
def test_each_number_made_huge_ends_in_a_code_or_is_taken(tmp_path: Path, reader: str, value: str) -> None:
    text = _valid().get(reader, b"").decode()
    name, read = READERS[reader]
    path = place(tmp_path, name)
    spots = [found.span() for found in re.finditer(r"(?<![\w.\"])-?\d+(\.\d+)?", text)]
    for start, end in spots[:: len(spots) // 8 + 1]:
        path.write_text(text[:start] + value + text[end:])
        opened(path, read)


@pytest.mark.parametrize(
    "row", ["a.jpg,1,0,6.7", "a.jpg,1,-900,6.7", "a.jpg,1,1e308,6.7", "a.jpg,1,900,0", "a.jpg,1,900,-6"]
)
def test_a_frame_has_a_focal_length_and_a_hand(tmp_path: Path, row: str) -> None:
    path = tmp_path / "frames.csv"
    path.write_text(f"path,label,fx,anchor_cm\n{row}\n")
    assert opened(path, read_frames) is not None


def _numbers(text: str) -> list[str]:
    """The keys of a TOML that hold a number, each once."""
    return sorted(set(re.findall(r"^(\w+) = -?[\d._]+$", text, re.MULTILINE)))


DEVICE_NUMBERS = [("device", key) for key in _numbers(DEFAULT_DEVICE.read_text())]
MOTOR_NUMBERS = [("motors", key) for key in _numbers(BUILT_IN_TABLE.read_text())]


@pytest.mark.parametrize("value", ["1e300", "-1e300", "9e18", "9000000000000000000", "-9000000000000000000"])
@pytest.mark.parametrize(("reader", "key"), [*DEVICE_NUMBERS, *MOTOR_NUMBERS])
def test_a_number_of_a_device_has_a_limit_at_both_ends(tmp_path: Path, reader: str, key: str, value: str) -> None:
    """A torque of 1e300 would take the guard's limit away."""
    name, read = READERS[reader]
    path = place(tmp_path, name)
    path.write_text(re.sub(rf"^{key} = .*$", f"{key} = {value}", _valid()[reader].decode(), flags=re.MULTILINE))
    assert opened(path, read) is not None


@pytest.mark.parametrize(("key", "value"), [("max_deg", "-40.0"), ("limit_c", "60.0")])
def test_the_limits_of_a_joint_stand_in_their_order(tmp_path: Path, key: str, value: str) -> None:
    path = tmp_path / "device.toml"
    text = re.sub(rf"^{key} = .*\n", "", DEFAULT_DEVICE.read_text(), flags=re.MULTILINE)
    path.write_text(text.replace("min_deg", f"{key} = {value}\nmin_deg"))
    assert opened(path, load_exoskeleton) is not None
