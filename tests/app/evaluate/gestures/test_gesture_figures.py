from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from app.cli.evaluate.keypoints import detected_images, fitted_beside
from app.cli.tree import command
from app.evaluate.gestures.corrections import shown_label
from app.evaluate.gestures.images import classify_all, load_hands, published_classifier, save_hands
from app.evaluate.gestures.measures import CLASSES, Classified, measure
from app.evaluate.gestures.report import (
    PAPER_TABLE_3,
    as_json,
    corrected_figures,
    corrected_shown,
    kinds_json,
    kinds_shown,
    plot_confusion,
    write_errors,
)
from app.evaluate.harness import EvaluateFault
from app.evaluate.readings import GESTURE_NAMES, DetectedImage, LabelledImage, read_labels
from app.system.errors import AppError
from app.text.catalogue import render
from kgdfa.gesture import Decision, Explanation, Gesture, Verdict
from logs.reason import reason
from tests.kgdfa.hands import STATES, drawn_hand
from tests.support.disks import full_disk

WHY = Explanation(Decision.NO_GESTURE)
UNREADABLE = reason(EvaluateFault.IMAGE_UNREADABLE, file="x.jpg")


def classified(label: str, predicted: str | None, confidence: float = 0.9, source: str = "s") -> Classified:
    scores = np.zeros(12)
    if predicted is None:
        return Classified(
            image=LabelledImage(path="", label=label, source=source), detected=False, verdict=None, scores=scores
        )
    gesture = Gesture(predicted) if predicted in GESTURE_NAMES else None
    scores[GESTURE_NAMES.index((gesture or Gesture.ONE).value)] = confidence
    verdict = Verdict(gesture=gesture, confidence=confidence, explanation=WHY)
    return Classified(
        image=LabelledImage(path="", label=label, source=source), detected=True, verdict=verdict, scores=scores
    )


def test_figures_follow_the_papers_equations() -> None:
    some = [
        classified("1", "1", 0.9),
        classified("1", "1", 0.8),
        classified("1", "2"),
        classified("2", "2"),
        classified("none:ok", "1", 0.85),
        classified("none:ok", "none", 0.1),
        classified("none:nohand", None),
        classified("2", None),
    ]
    figures = measure(some)
    one = figures.per_gesture["1"]
    assert (one.pre, one.re, one.iou, one.n) == (2 / 3, 2 / 3, 2 / 4, 3)
    assert one.f1 == pytest.approx(2 / 3)
    # Ranked by confidence in 1: right 0.9, wrong 0.85, right 0.8; the third 1 has none.
    assert one.ap == pytest.approx((1 + 2 / 3 + 3 / 8) / 3)
    assert figures.per_gesture["2"].re == 0.5
    assert figures.macro_f1 == pytest.approx((2 / 3 + 0.5) / 2)
    assert figures.accepted_undefined == pytest.approx(1 / 3)
    assert figures.wrong_gesture == pytest.approx(1 / 5)  # a 1 taken for 2; the 2 without a hand is none
    assert figures.per_kind == {"none:nohand": (0.0, 1), "none:ok": (0.5, 2)}
    assert figures.per_source["s"].detected == pytest.approx(6 / 7)
    assert figures.confusion.sum() == len(some)
    assert figures.confusion[CLASSES.index("none"), CLASSES.index("1")] == 1


def test_the_report_has_the_shape_that_is_promised() -> None:
    some = [classified(name, name) for name in GESTURE_NAMES]
    detected = [DetectedImage(image=one.image, hands=()) for one in some] + [
        DetectedImage(image=LabelledImage(path="x.jpg", label="1"), hands=(), error=UNREADABLE)
    ]
    report = as_json({"published": measure(some)}, {}, detected, cross_validated=True, views=1, prepare="denoise")
    assert (report["images"], report["cross_validated"], report["views"]) == (13, True, 1)
    assert report["prepare"] == "denoise"
    rules = report["rules"]["published"]
    assert rules["macro_f1"] == rules["map"] == 1.0
    assert set(rules["per_gesture"]) == set(PAPER_TABLE_3)
    assert {"pre", "re", "f1", "ap", "n"} <= set(rules["per_gesture"]["love"])
    assert report["unreadable"] == [
        {"path": "x.jpg", "error": {"code": "EvaluateFault.IMAGE_UNREADABLE", "values": {"file": "x.jpg"}}}
    ]


def test_figures_are_told_as_labelled_and_once_more_with_wrong_labels_corrected() -> None:
    exchanged = replace(classified("4", "5"), image=LabelledImage(path="images/massey_4_0031.jpeg", label="4"))
    some = [exchanged, classified("5", "5")]
    assert measure(some).wrong_gesture == 0.5
    assert corrected_figures({"robust": some})["robust"].wrong_gesture == 0
    assert corrected_figures({"robust": some[1:]}) == {}
    (summary,) = corrected_shown(corrected_figures({"robust": some}), {"robust": some})
    assert "with 1 labels corrected" in summary
    assert "macro-F1 1.0000" in summary


def test_a_list_of_labels_that_is_right_is_left_as_it_is() -> None:
    right = LabelledImage(path="images/massey_4_0031.jpeg", label="5")
    assert shown_label(right) == "5"
    assert shown_label(replace(right, label="4")) == "5"
    assert shown_label(LabelledImage(path="images/massey_4_0030.jpeg", label="4")) == "4"


def test_kinds_that_the_fit_never_saw_are_shown_one_by_one() -> None:
    figures = measure([classified("none:ok", "1"), classified("none:ok", "none"), classified("none:claw", "none")])
    kinds, summary = kinds_shown(figures)
    assert not isinstance(kinds, str)
    assert isinstance(summary, str)
    assert [[str(cell) for cell in column.cells] for column in kinds.columns] == [
        ["none:claw", "none:ok"],
        ["0.0%", "50.0%"],
        ["1", "2"],
    ]
    assert "33.33%" in summary
    assert kinds_json(figures)["kinds_left_out"]["none:ok"] == {"accepted": 0.5, "n": 2}
    assert kinds_json(None) == {}


@pytest.mark.parametrize(
    ("text", "fault", "line"),
    [
        ("", EvaluateFault.TABLE_COLUMNS, None),
        ("path,label\na.jpg,1\n", EvaluateFault.TABLE_COLUMNS, None),
        ("path,label,source,group\n", EvaluateFault.TABLE_EMPTY, None),
        ("path,label,source,group\na.jpg,1,s,g\nb.jpg,eleven,s,g\n", EvaluateFault.ROW_LABEL, 3),
        ("path,label,source,group\na.jpg,none:,s,g\n", EvaluateFault.ROW_LABEL, 2),
        ("path,label,source,group\na.jpg,1,s\n", EvaluateFault.ROW_FIELDS, 2),
        ("path,label,source,group\n,1,s,g\n", EvaluateFault.ROW_PATH, 2),
        ('path,label,source,group\n"a\nb.jpg",1,s,g\n\nc.jpg,nope,s,g\n', EvaluateFault.ROW_LABEL, 5),
    ],
)
def test_bad_label_files_are_refused_by_line(tmp_path: Path, text: str, fault: EvaluateFault, line: int | None) -> None:
    (tmp_path / "labels.csv").write_text(text)
    with pytest.raises(AppError) as caught:
        read_labels(tmp_path)
    assert (caught.value.code, caught.value.values.get("line")) == (fault, line)
    assert str(tmp_path / "labels.csv") in render(caught.value)


@pytest.mark.parametrize("content", [None, b"\xff\xfe\x00\x80"])
def test_a_missing_or_binary_label_file_is_refused(tmp_path: Path, content: bytes | None) -> None:
    if content is not None:
        (tmp_path / "labels.csv").write_bytes(content)
    with pytest.raises(AppError) as caught:
        read_labels(tmp_path)
    assert caught.value.code is EvaluateFault.FILE_UNREADABLE


def drawn_images() -> list[DetectedImage]:
    return [
        DetectedImage(
            image=LabelledImage(path=f"{gesture.value}.png", label=gesture.value), hands=(drawn_hand(states),)
        )
        for gesture, states in STATES.items()
    ]


def test_keypoints_survive_their_file(tmp_path: Path) -> None:
    detected = [
        *drawn_images(),
        DetectedImage(image=LabelledImage(path="none.png", label="none:nohand"), hands=(), error=UNREADABLE),
    ]
    save_hands(detected, tmp_path / "looks.npz")
    again = load_hands(tmp_path / "looks.npz", [one.image for one in detected])
    assert [one.error for one in again] == [one.error for one in detected]
    for one, before in zip(again, detected, strict=True):
        assert len(one.hands) == len(before.hands)
        for hand, own in zip(one.hands, before.hands, strict=True):
            np.testing.assert_allclose(hand.image_px, own.image_px, rtol=1e-6)
    with np.load(tmp_path / "looks.npz") as stored:  # as files of 0.1 are
        old = {name: stored[name] for name in stored.files if name not in ("images", "prepare")}
        old["photos"] = np.where(np.char.startswith(stored["images"], "{"), "no picture", stored["images"])
    np.savez_compressed(tmp_path / "old.npz", **old)
    assert len(load_hands(tmp_path / "old.npz", [one.image for one in detected])) == len(detected)
    with pytest.raises(AppError) as caught:
        load_hands(tmp_path / "looks.npz", [LabelledImage(path="else.png", label="1")])
    assert caught.value.code is EvaluateFault.KEYPOINTS_OF_OTHERS


def test_misclassified_images_are_drawn_and_the_matrix_is_plotted(tmp_path: Path) -> None:
    detected = drawn_images()
    for one in detected:
        cv2.imwrite(str(tmp_path / one.image.path), np.full((700, 800, 3), 90, np.uint8))
    verdicts = classify_all(detected, published_classifier())
    assert write_errors(verdicts, detected, tmp_path, tmp_path / "errors") == 0
    mislabelled = [DetectedImage(image=LabelledImage(path="1.png", label="2"), hands=detected[1].hands)]
    wrong = classify_all(mislabelled, published_classifier())
    assert write_errors(wrong, mislabelled, tmp_path, tmp_path / "errors") == 1
    drawn = cv2.imread(str(tmp_path / "errors" / "00001_2_as_1_1.png"))
    assert drawn is not None
    assert len(np.unique(drawn.reshape(-1, 3), axis=0)) > 5
    plot_confusion({"published": measure(verdicts)}, tmp_path / "confusion.png")
    assert cv2.imread(str(tmp_path / "confusion.png")) is not None


def test_every_misclassified_image_has_a_file_of_its_own(tmp_path: Path) -> None:
    deep = "/".join(["手" * 20] * 5)  # 304 bytes, each name within 255
    paths = ("a-b/1.png", "a/b-1.png", "a/b/1.png", "a/b/1.jpg", f"{deep}/a.png", f"{deep}/b.png")
    for folder in ("a-b", "a/b", deep):
        (tmp_path / folder).mkdir(parents=True)
    for path in paths:
        cv2.imwrite(str(tmp_path / path), np.zeros((1, 2000, 3), np.uint8))  # as thin as any that can be drawn larger
    missed = [DetectedImage(image=LabelledImage(path=path, label="3"), hands=()) for path in paths]
    assert write_errors(classify_all(missed, published_classifier()), missed, tmp_path, tmp_path / "errors") == 6
    names = sorted(path.name for path in (tmp_path / "errors").iterdir())
    assert names[:4] == [f"0000{row}_3_as_none_a-b-1.png" for row in (1, 2, 3, 4)]
    assert [(name[:6], name[-6:]) for name in names[4:]] == [("00005_", "-a.png"), ("00006_", "-b.png")]


def test_an_error_of_any_label_has_a_file(tmp_path: Path) -> None:
    photo = np.zeros((1, 2000, 3), np.uint8)
    cv2.imwrite(str(tmp_path / "1.png"), photo)
    labels = ("none:" + "很" * 100, "none:a/../b")
    taken = [
        DetectedImage(image=LabelledImage(path="1.png", label=label), hands=drawn_images()[1].hands) for label in labels
    ]
    assert write_errors(classify_all(taken, published_classifier()), taken, tmp_path, tmp_path / "errors") == 2
    names = sorted(path.name for path in (tmp_path / "errors").iterdir())
    assert names == [f"00001_{'很' * 26}_as_1_1.png", "00002_none-a-..-b_as_1_1.png"]


def labelled_folder(folder: Path, drawn: list[DetectedImage]) -> None:
    lines = [",".join(msgspec.to_builtins(one.image).values()) for one in drawn]
    (folder / "labels.csv").write_text("path,label,source,group\n" + "\n".join(lines) + "\n")


def test_keypoints_of_another_preprocessing_are_refused(tmp_path: Path) -> None:
    drawn, file = drawn_images(), tmp_path / "keypoints"
    labelled_folder(tmp_path, drawn)
    for kept, wanted in (("none", "denoise"), ("denoise", "none")):
        save_hands(drawn, file, kept)
        assert len(detected_images(tmp_path, file, None, kept)) == len(drawn)
        with pytest.raises(AppError) as caught:
            detected_images(tmp_path, file, None, wanted)
        assert caught.value.code is EvaluateFault.KEYPOINTS_OF_OTHERS


def test_keypoints_take_the_name_that_was_given_and_only_as_a_whole(tmp_path: Path) -> None:
    file = tmp_path / "keypoints"
    save_hands(drawn_images(), file)
    before = file.read_bytes()
    with full_disk(100), pytest.raises(AppError) as refused:
        save_hands(drawn_images(), file)
    assert refused.value.code is EvaluateFault.FILE_UNWRITABLE
    assert [*tmp_path.iterdir()] == [file]
    assert file.read_bytes() == before


def test_a_fit_takes_the_keypoints_that_lie_in_a_further_folder(tmp_path: Path) -> None:
    drawn = drawn_images()
    labelled_folder(tmp_path, drawn)
    save_hands(drawn, tmp_path / "keypoints.npz")
    again = fitted_beside(tmp_path, None, None)
    assert [one.image for one in again] == [one.image for one in drawn]
    assert all(one.hands for one in again)


def test_images_beside_need_a_fit(tmp_path: Path) -> None:
    with pytest.raises(AppError) as caught:
        command().main(["evaluate", "gestures", str(tmp_path), "--with", str(tmp_path)], standalone_mode=False)
    assert caught.value.code is EvaluateFault.WITH_ALONE
