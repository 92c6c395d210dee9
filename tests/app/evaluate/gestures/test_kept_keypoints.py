"""`--keypoints`: what a file keeps of photos, and which of them are detected anew."""

from __future__ import annotations

import os
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from app.cli.evaluate.keypoints import detected_images
from app.cli.tree import command
from app.evaluate.gestures.images import contents_of, load_hands, save_hands, unseen_image
from app.evaluate.harness import EvaluateFault
from app.evaluate.readings import DetectedImage, LabelledImage, read_labels
from app.system.errors import AppError
from kgdfa.gesture import Gesture
from kgdfa.hand import Hand
from tests.kgdfa.hands import STATES, drawn_hand

FIVE = drawn_hand(STATES[Gesture.FIVE])
NAMES = ("a.png", "b.png", "c.png", "d.png")


class Lamp:
    """Finds a hand in bright images; counts those that it was shown, and is interrupted after so many."""

    def __init__(self) -> None:
        self.shown: list[int] = []
        self.most = 100

    def detect(self, image: Any, _captured_ns: int = 0) -> tuple[Hand, ...]:
        if len({*self.shown, int(image.max())}) > self.most:
            raise KeyboardInterrupt
        self.shown.append(int(image.max()))
        return (FIVE,) if image.max() > 127 else ()

    def reset(self, _captured_ns: int = 0) -> None:
        """It remembers nothing."""


@pytest.fixture
def lamp(monkeypatch: pytest.MonkeyPatch) -> Lamp:
    made = Lamp()
    monkeypatch.setattr("kgdfa.keypoints.HandDetector", lambda *_, **__: nullcontext(made))
    monkeypatch.setattr("app.cli.evaluate.keypoints.hand_model", lambda _: Path("model"))
    monkeypatch.setattr("os.cpu_count", lambda: 1)  # in their order
    return made


def photo(folder: Path, name: str, level: int) -> None:
    cv2.imwrite(str(folder / name), np.full((40, 40, 3), level, np.uint8))


def folder_of(folder: Path, levels: dict[str, int]) -> None:
    """Four lines; photos of these, each of its brightness."""
    (folder / "labels.csv").write_text("path,label,source,group\n" + "".join(f"{name},5,s,g\n" for name in NAMES))
    for name, level in levels.items():
        photo(folder, name, level)


def hands_and_errors(detected: list[DetectedImage]) -> list[tuple[int, bool]]:
    return [(len(one.hands) > 0, one.error is not None) for one in detected]


DARK, BRIGHT, LOST = (False, False), (True, False), (False, True)


def test_photos_that_came_later_are_detected_and_the_others_are_not(tmp_path: Path, lamp: Lamp) -> None:
    folder_of(tmp_path, {"a.png": 200, "b.png": 100})
    file = tmp_path / "k.npz"
    first = detected_images(tmp_path, file, None)
    assert hands_and_errors(first) == [BRIGHT, DARK, LOST, LOST]
    lamp.shown.clear()
    assert hands_and_errors(detected_images(tmp_path, file, None)) == [BRIGHT, DARK, LOST, LOST]
    assert lamp.shown == []
    photo(tmp_path, "c.png", 210)
    for _ in range(2):
        assert hands_and_errors(detected_images(tmp_path, file, None)) == [BRIGHT, DARK, BRIGHT, LOST]
    assert set(lamp.shown) == {210}
    assert [one.error is None for one in load_hands(file, read_labels(tmp_path))] == [True, True, True, False]


def test_a_photo_with_other_contents_is_detected_anew_and_a_copy_is_not(tmp_path: Path, lamp: Lamp) -> None:
    folder_of(tmp_path, dict.fromkeys(NAMES, 200))
    file = tmp_path / "k.npz"
    detected_images(tmp_path, file, None)
    lamp.shown.clear()
    os.utime(tmp_path / "a.png", (1.0, 1.0))
    (tmp_path / "b.png").unlink()
    photo(tmp_path, "c.png", 50)
    for _ in range(2):
        assert hands_and_errors(detected_images(tmp_path, file, None)) == [BRIGHT, BRIGHT, DARK, BRIGHT]
    assert max(lamp.shown) < 100, "brightened"


def test_keypoints_without_photos_need_no_model(tmp_path: Path) -> None:
    folder_of(tmp_path, {})
    kept = [DetectedImage(image=one, hands=(FIVE,), contents="f" * 64) for one in read_labels(tmp_path)]
    save_hands(kept, tmp_path / "k.npz")
    assert hands_and_errors(detected_images(tmp_path, tmp_path / "k.npz", Path("no home"))) == [BRIGHT] * 4


def test_an_older_file_says_nothing_of_contents_and_its_errors_are_tried_again(tmp_path: Path, lamp: Lamp) -> None:
    folder_of(tmp_path, dict.fromkeys(NAMES, 200))
    listed = read_labels(tmp_path)
    save_hands([*(DetectedImage(image=one, hands=()) for one in listed[:3]), unseen_image(listed[3])], tmp_path / "k")
    with np.load(tmp_path / "k") as stored:
        older = {name: stored[name] for name in stored.files if name != "contents"}
    np.savez_compressed(tmp_path / "k.npz", **older)
    assert hands_and_errors(detected_images(tmp_path, tmp_path / "k.npz", None)) == [DARK, DARK, DARK, BRIGHT]
    assert set(lamp.shown) == {200}


def test_an_interrupted_detection_goes_on(tmp_path: Path, lamp: Lamp, capsys: pytest.CaptureFixture[str]) -> None:
    folder_of(tmp_path, {"a.png": 200, "b.png": 201, "c.png": 202, "d.png": 203})
    file, lamp.most = tmp_path / "k.npz", 2
    with pytest.raises(KeyboardInterrupt):
        detected_images(tmp_path, file, None)
    assert "2 of 4 images are kept in" in capsys.readouterr().out.replace("\n", " ")
    assert hands_and_errors(load_hands(file, read_labels(tmp_path))) == [BRIGHT, BRIGHT, LOST, LOST]
    lamp.most = 100
    lamp.shown.clear()
    assert hands_and_errors(detected_images(tmp_path, file, None)) == [BRIGHT] * 4
    assert set(lamp.shown) == {202, 203}


def test_ctrl_c_ends_the_command_with_130(tmp_path: Path, lamp: Lamp) -> None:
    folder_of(tmp_path, {"a.png": 200, "b.png": 201})
    lamp.most = 1
    with pytest.raises(SystemExit) as ended:
        command().main(["evaluate", "gestures", str(tmp_path), "--keypoints", str(tmp_path / "k.npz")])
    assert ended.value.code == 130
    assert (tmp_path / "k.npz").exists()


def test_what_can_not_be_read_stays_so_without_writing(tmp_path: Path, lamp: Lamp) -> None:
    folder_of(tmp_path, {"a.png": 200})
    (tmp_path / "b.png").write_text("no image")
    file = tmp_path / "k.npz"
    detected_images(tmp_path, file, None)
    os.utime(file, (1.0, 1.0))
    assert hands_and_errors(detected_images(tmp_path, file, None)) == [BRIGHT, LOST, LOST, LOST]
    assert (file.stat().st_mtime, set(lamp.shown)) == (1.0, {200})


def test_a_folder_without_one_readable_photo_keeps_nothing(tmp_path: Path, lamp: Lamp) -> None:
    folder_of(tmp_path, {})
    (tmp_path / "b.png").write_text("no image")
    with pytest.raises(AppError) as refused:
        detected_images(tmp_path, tmp_path / "k.npz", None)
    assert (refused.value.code, refused.value.values["file"]) == (EvaluateFault.IMAGE_UNREADABLE, "a.png")
    assert not (tmp_path / "k.npz").exists()
    assert lamp.shown == []


def test_what_is_no_regular_file_has_no_contents(tmp_path: Path) -> None:
    assert {contents_of(path) for path in (tmp_path, tmp_path / "gone", Path("/dev/null"), tmp_path / "\0")} == {""}
    (tmp_path / "a").write_bytes(b"abc")
    assert contents_of(tmp_path / "a").startswith("ba7816bf")
    assert unseen_image(LabelledImage(path="x.png", label="3")).contents == ""
