"""Images that can't be used are named, and stand in no share that they would flatter; a share of nothing is none."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from app.cli.common import show
from app.cli.evaluate.common import unreadable_lines
from app.cli.evaluate.keypoints import detected_images
from app.evaluate.distance.frames import figures as distance_figures
from app.evaluate.distance.frames import measure_frames
from app.evaluate.distance.table5 import _Held, _row
from app.evaluate.distance.table5_results import Table5, tables
from app.evaluate.gestures.ablation import measure_preparations, photos, preparation_table
from app.evaluate.gestures.images import classify_all, detect_images, published_classifier
from app.evaluate.gestures.measures import NOT_SHOWN, measure, measure_sequence
from app.evaluate.gestures.report import as_json, kinds_shown, sequence_table, shown
from app.evaluate.gestures.side import SideFigures, measure_looks, measure_photos
from app.evaluate.harness import MODES, EvaluateFault
from app.evaluate.readings import DetectedImage, LabelledFrame, LabelledImage, read_image
from app.system.errors import AppError
from app.text.catalogue import render, use_language
from hal.cameras.playback import MAX_PIXELS
from hal.errors import HardwareError, RecordingFault
from kgdfa.gesture import Gesture
from kgdfa.hand import Hand
from logs.reading.regular import MAX_IMAGE
from logs.reason import Reason, reason
from tests.kgdfa.hands import STATES, drawn_hand

FIVE = drawn_hand(STATES[Gesture.FIVE])
UNREADABLE = reason(EvaluateFault.IMAGE_UNREADABLE, file="x.png")
GUN = DetectedImage(image=LabelledImage(path="x.png", label="none:gun", source="s"), hands=(FIVE,))
LOST = replace(GUN, hands=(), error=UNREADABLE)


class Blind:
    """A detector that finds nothing."""

    def detect(self, _image: Any, _captured_ns: int = 0) -> tuple[Hand, ...]:
        return ()

    def reset(self, _captured_ns: int) -> None:
        """It remembers nothing."""


BLIND: Any = Blind()  # of its interface what is used here


@pytest.fixture
def listed(tmp_path: Path) -> list[LabelledImage]:
    """One that can be read, one whose numbers no detector takes, and one that isn't there."""
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((40, 40, 3), np.uint8))
    Image.fromarray(np.zeros((40, 40), np.float32)).save(tmp_path / "float.tiff")
    return [LabelledImage(path=path, label="3") for path in ("a.png", "float.tiff", "gone.png")]


CODES = {"float.tiff": "KgdfaFault.IMAGE_NUMBERS", "gone.png": "EvaluateFault.IMAGE_UNREADABLE"}


def codes(unreadable: dict[str, Reason]) -> dict[str, str]:
    return {path: why.code for path, why in unreadable.items()}


def test_an_image_is_read_or_why_not(listed: list[LabelledImage], tmp_path: Path) -> None:
    image, *others = (read_image(one, tmp_path) for one in listed)
    assert isinstance(image, np.ndarray)
    assert [one.code for one in others if isinstance(one, Reason)] == list(CODES.values())


def test_the_side_of_a_hand_counts_those_that_can_be_read_and_names_the_others(
    listed: list[LabelledImage], tmp_path: Path
) -> None:
    figures = measure_photos(BLIND, listed, tmp_path, lambda: None)
    assert (figures.images, figures.without, codes(figures.unreadable)) == (1, 1, CODES)
    stored = measure_looks([replace(LOST, image=replace(LOST.image, label="5")), LOST])
    assert stored.unreadable == {"x.png": UNREADABLE}, "undefined hands are not asked for"
    assert (stored.images, stored.without) == (0, 0)


def test_a_stored_gesture_without_a_hand_counts_as_without_a_vote_as_its_photo_does() -> None:
    five = LabelledImage(path="a.png", label="5", source="s", group="g")
    figures = measure_looks([DetectedImage(image=five, hands=()), replace(GUN, hands=())])
    assert (figures.images, figures.without, figures.sources, figures.right) == (1, 1, {}, None)


def test_preparations_are_measured_on_those_that_can_be_read_and_the_others_are_named(
    listed: list[LabelledImage], tmp_path: Path
) -> None:
    unreadable: dict[str, Reason] = {}
    (first, *_) = measured = measure_preparations(photos(listed, tmp_path, unreadable), BLIND)
    assert (first.images, first.found, first.accepted_undefined) == (1, 0.0, None)
    assert codes(unreadable) == CODES
    cells = [str(next(iter(column.cells))) for column in preparation_table(measured[:1], {"none": 1.0}).columns]
    assert cells[-4:] == ["0.0%", "0.0%", "–", "1.0"]
    assert unreadable_lines(unreadable)[0] == "2 images could not be read and are left out:"


def test_rows_are_counted_and_an_image_is_named_once() -> None:
    count, *named = unreadable_lines({"x.png": UNREADABLE}, "gestures.unreadable", rows=3)
    assert count.startswith("3 rows name images that could not be read")
    (line,) = named
    assert line.startswith("  x.png: x.png is missing, or no image that can be read (")


def test_what_a_list_names_is_no_markup_and_nothing_that_a_terminal_obeys(capsys: pytest.CaptureFixture[str]) -> None:
    one = replace(GUN, image=LabelledImage(path="x.png", label="none:person[left]", source="a[/b]\x1b[2J:smile:"))
    figures = measure(classify_all([one], published_classifier()))
    sequence = sequence_table(Path("[red]a[/x].mp4"), {"robust": measure_sequence(["skip"], ["none"], ["none"])})
    show(*shown("published", figures, 1), sequence, *unreadable_lines({"[/c]\x1b[2J": UNREADABLE}))
    printed = capsys.readouterr().out
    assert "\x1b" not in printed
    for text in ("none:person[left]", r"a[/b]\x1b[2J:smile:", "[red]a[/x].mp4: 1 frames", r"[/c]\x1b[2J"):
        assert text in printed


def test_frames_of_a_distance_that_can_not_be_read_are_named(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((40, 40, 3), np.uint8))
    frames = [
        LabelledFrame(path=tmp_path / name, focal_px=900.0, reference_m=0.067, distance_m=0.4)
        for name in ("a.png", "gone.png")
    ]
    result = measure_frames(frames, BLIND, lambda: None).as_json()
    assert (result["frames"], result["unreadable"]) == (2, [str(tmp_path / "gone.png")])


def test_an_undefined_hand_that_can_not_be_read_was_not_refused() -> None:
    figures = measure(classify_all([GUN, LOST], published_classifier()))
    assert figures.accepted_undefined == 1.0
    assert figures.per_kind == {"none:gun": (1.0, 1)}
    assert figures.per_source["s"].accepted_undefined == 1.0
    gesture = replace(LOST, image=replace(LOST.image, label="5"))
    assert measure(classify_all([gesture], published_classifier())).per_gesture["5"].re == 0.0


def test_a_source_without_a_name_is_none_that_has_that_name(capsys: pytest.CaptureFixture[str]) -> None:
    five = replace(GUN, image=replace(GUN.image, label="5"))
    sources = [replace(five, image=replace(five.image, source=name)) for name in ("", "unnamed", "unnamed")]
    two = measure(classify_all(sources, published_classifier()))
    assert {name: one.n for name, one in two.per_source.items()} == {"": 1, "unnamed": 2}
    one = measure(classify_all(sources[:1], published_classifier()))
    for figures, keys in ((one, {"unnamed"}), (two, {"", "unnamed"})):
        made = as_json({"published": figures}, {}, [], cross_validated=False, views=None, prepare="none")
        assert made["rules"]["published"]["per_source"].keys() == keys
    use_language("zh")
    show(*shown("published", one, 1))
    printed = capsys.readouterr().out
    assert "未命名" in printed
    assert "unnamed" not in printed


def test_shares_of_nothing_are_none_and_shown_as_a_dash() -> None:
    five = replace(GUN, image=replace(GUN.image, label="5"))
    without_undefined = measure(classify_all([five], published_classifier()))
    assert (without_undefined.accepted_undefined, without_undefined.wrong_gesture) == (None, 0.0)
    assert without_undefined.per_source["s"].accepted_undefined is None
    summary = [*shown("published", without_undefined, 1)][1]
    assert "undefined accepted –, gestures taken for another 0.00%" in str(summary)
    assert "–" in str([*kinds_shown(without_undefined)][1])
    without_gestures = measure(classify_all([GUN], published_classifier()))
    assert (without_gestures.macro_f1, without_gestures.map, without_gestures.per_source["s"].right) == (None,) * 3
    assert "macro-F1 – (paper 0.8954)" in str([*shown("published", without_gestures, 1)][1])
    assert SideFigures().right is None


def test_a_gesture_that_no_image_shows_has_no_figures() -> None:
    figures = measure(classify_all([replace(GUN, image=replace(GUN.image, label="love"))], published_classifier()))
    assert figures.per_gesture["5"] == NOT_SHOWN, "one was taken for it, none shows it"
    love = figures.per_gesture["love"]
    assert (love.pre, love.re, love.iou, love.f1, love.n) == (None, 0.0, 0.0, 0.0, 1), "none was taken for it"
    assert (figures.macro_f1, figures.map) == (0.0, love.ap)
    (table, *_) = shown("published", figures, 1)
    assert not isinstance(table, str)
    rows = {str(cells[0]): [*map(str, cells[1:])] for cells in zip(*(one.cells for one in table.columns), strict=True)}
    assert rows["5"] == ["– (99.1)", "– (96.0)", "– (96.9)", "– (95.2)", "– (99.0)", "0"]
    assert rows["love"][:2] == ["– (98.9)", "0.0 (94.7)"]
    made = as_json({"published": figures}, {}, [], cross_validated=False, views=None, prepare="none")
    line = dict.fromkeys(("pre", "re", "iou", "f1", "ap"), None)
    assert made["rules"]["published"]["per_gesture"]["5"] == line | {"n": 0}


UNREAD = [LabelledImage(path=rf"images\{number}.jpg", label="3") for number in (1, 2)]


@pytest.mark.parametrize(
    "measured",
    [
        lambda folder: detected_images(folder, None, None),
        lambda folder: measure_photos(BLIND, UNREAD, folder, lambda: None),
        lambda folder: measure_preparations(photos(UNREAD, folder, {}), BLIND),
        lambda folder: measure_frames(
            [
                LabelledFrame(path=folder / one.path, focal_px=900.0, reference_m=0.067, distance_m=0.4)
                for one in UNREAD
            ],
            BLIND,
            lambda: None,
        ),
    ],
    ids=["gestures", "side", "preprocessing", "distance"],
)
def test_a_folder_of_which_no_image_can_be_read_gives_no_figures(
    tmp_path: Path, measured: Callable[[Path], object]
) -> None:
    rows = "".join(f"{one.path},3,,\n" for one in UNREAD)
    (tmp_path / "labels.csv").write_text("path,label,source,group\n" + rows)
    with pytest.raises(AppError) as refused:
        measured(tmp_path)
    assert refused.value.code is EvaluateFault.IMAGE_UNREADABLE
    assert str(refused.value.values["file"]).endswith(r"images\1.jpg")


def test_an_image_that_memory_does_not_hold_is_unreadable_and_the_others_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("kgdfa.keypoints.HandDetector", lambda *_, **__: nullcontext(BLIND))
    listed = [LabelledImage(path=f"{number}.png", label="3") for number in range(4)]
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((40, 40, 3), np.uint8))
    for number, width in ((1, 50), (2, 60)):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.zeros((1, width, 3), np.uint8))
    Image.new("1", (1, 1_000_000)).save(tmp_path / "3.png")

    def prepare(image: NDArray[Any]) -> NDArray[np.uint8]:
        if image.shape[1] == 50:
            raise MemoryError
        if image.shape[1] == 60:
            cv2.copyMakeBorder(image, 0, 0, 0, -1, cv2.BORDER_CONSTANT)
        return np.asarray(image, np.uint8)

    detected = [*detect_images(listed, tmp_path, Path("model"), prepare)]
    assert [one.error and one.error.code for one in detected] == [None, UNREADABLE.code, UNREADABLE.code, None]


def test_the_text_names_the_largest_image_that_is_read() -> None:
    limits = (MAX_IMAGE >> 20, MAX_PIXELS // 1_000_000)
    assert "up to {} MB and {} megapixels".format(*limits) in render(UNREADABLE)
    assert "larger than {} MB or {} megapixels".format(*limits) in render(
        HardwareError(RecordingFault.IMAGE_UNREADABLE, path="x.png")
    )


def test_a_sequence_of_nothing_but_pauses_has_no_accuracy() -> None:
    figures = measure_sequence(["skip"] * 3, ["none"] * 3, ["none"] * 3)
    assert (figures.frame_accuracy, figures.voted_accuracy) == (None, None)
    cells = [str(cell) for cell in sequence_table(Path("x"), {"robust": figures}).columns[1].cells]
    assert cells[:3] == ["3", "–", "–"]


def test_distances_of_which_none_was_measured_have_no_shares() -> None:
    nothing = distance_figures(np.ones(2), np.full(2, np.nan), np.full(2, np.nan))
    assert nothing.cells() == ("2", "2", *("–",) * 6)
    written = msgspec.json.decode(msgspec.json.encode(nothing.as_json()))
    assert written == dict.fromkeys(written, None) | {"missing": 2}


def test_a_hand_that_was_found_in_no_frame_has_no_share_of_zeros_in_its_depth() -> None:
    def held(zero: float | None) -> _Held:
        nothing = {name: np.full(2, np.nan) for name in MODES}
        return _Held(mono=nothing, depth=nothing, zero=zero)

    assert _row(40, [held(0.5), held(None), held(0.0)]).depth_zero == 0.25
    row = _row(40, [held(None)])
    assert row.as_json()["d435i_zero_share"] is None
    (table, *_) = tables(Table5(hands=1, focal_px=650.0, rows=(row,), tilts=(), walk={}))
    assert [str(cell) for cell in table.columns[-1].cells] == ["–"]
