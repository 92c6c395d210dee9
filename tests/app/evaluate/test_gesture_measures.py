from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from app.evaluate.gesture_judge import PublishedJudge, judge_all
from app.evaluate.gesture_measures import CLASSES, GESTURE_NAMES, Judged, measure
from app.evaluate.gesture_photos import Photo, SeenPhoto, read_labels
from app.evaluate.gesture_report import PAPER_TABLE_3, as_json, write_confusion, write_errors
from app.evaluate.keypoint_file import load_seen, save_seen
from app.system.errors import AppError
from kgdfa.gesture import Gesture, Verdict
from tests.kgdfa.hands import STATES, drawn_hand


def judged(label: str, said: str | None, confidence: float = 0.9, source: str = "s") -> Judged:
    scores = np.zeros(12)
    if said is None:
        return Judged(photo=Photo(path="", label=label, source=source), detected=False, verdict=None, scores=scores)
    gesture = Gesture(said) if said in GESTURE_NAMES else None
    nearest = gesture or Gesture.ONE
    scores[GESTURE_NAMES.index(nearest.value)] = confidence
    verdict = Verdict(gesture=gesture, confidence=confidence, nearest=nearest, explanation="")
    return Judged(photo=Photo(path="", label=label, source=source), detected=True, verdict=verdict, scores=scores)


def test_figures_follow_the_papers_equations() -> None:
    some = [
        judged("1", "1", 0.9),
        judged("1", "1", 0.8),
        judged("1", "2"),
        judged("2", "2"),
        judged("none:ok", "1", 0.85),
        judged("none:ok", "none", 0.1),
        judged("none:nohand", None),
        judged("2", None),
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
    assert figures.per_kind == {"none:nohand": (0.0, 1), "none:ok": (0.5, 2)}
    assert figures.per_source["s"].detected == pytest.approx(6 / 7)
    assert figures.confusion.sum() == len(some)
    assert figures.confusion[CLASSES.index("none"), CLASSES.index("1")] == 1


def test_the_report_has_the_shape_that_is_promised() -> None:
    some = [judged(name, name) for name in GESTURE_NAMES]
    seen = [SeenPhoto(photo=one.photo, hands=()) for one in some] + [
        SeenPhoto(photo=Photo(path="x.jpg", label="1"), hands=(), error="no picture")
    ]
    report = as_json({"published": measure(some)}, seen, "how")
    assert report["images"] == 13
    rules = report["rules"]["published"]
    assert rules["macro_f1"] == rules["map"] == 1.0
    assert set(rules["per_gesture"]) == set(PAPER_TABLE_3)
    assert {"pre", "re", "f1", "ap", "n"} <= set(rules["per_gesture"]["love"])
    assert report["unreadable"] == [{"path": "x.jpg", "error": "no picture"}]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "line 1: the columns"),
        ("path,label\na.jpg,1\n", "line 1: the columns"),
        ("path,label,source,group\n", "lists no picture"),
        ("path,label,source,group\na.jpg,1,s,g\nb.jpg,eleven,s,g\n", "line 3: unknown label 'eleven'"),
        ("path,label,source,group\na.jpg,none:,s,g\n", "line 2: unknown label"),
        ("path,label,source,group\na.jpg,1,s\n", "line 2: 3 fields where 4"),
        ("path,label,source,group\n,1,s,g\n", "line 2: the path is empty"),
    ],
)
def test_bad_label_files_are_refused_by_line(tmp_path: Path, text: str, complaint: str) -> None:
    (tmp_path / "labels.csv").write_text(text)
    with pytest.raises(AppError, match=complaint):
        read_labels(tmp_path)


def test_a_missing_or_binary_label_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(AppError, match="can't be read"):
        read_labels(tmp_path)
    (tmp_path / "labels.csv").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(AppError, match="can't be read"):
        read_labels(tmp_path)


def drawn_photos() -> list[SeenPhoto]:
    return [
        SeenPhoto(photo=Photo(path=f"{gesture.value}.png", label=gesture.value), hands=(drawn_hand(states),))
        for gesture, states in STATES.items()
    ]


def test_keypoints_survive_their_file(tmp_path: Path) -> None:
    seen = [*drawn_photos(), SeenPhoto(photo=Photo(path="none.png", label="none:nohand"), hands=(), error="dark")]
    save_seen(seen, tmp_path / "looks.npz")
    again = load_seen(tmp_path / "looks.npz", [one.photo for one in seen])
    assert [one.error for one in again] == [one.error for one in seen]
    for one, before in zip(again, seen, strict=True):
        assert len(one.hands) == len(before.hands)
        for hand, own in zip(one.hands, before.hands, strict=True):
            np.testing.assert_allclose(hand.image_px, own.image_px, rtol=1e-6)
    with pytest.raises(AppError, match="other pictures"):
        load_seen(tmp_path / "looks.npz", [Photo(path="else.png", label="1")])


def test_misjudged_pictures_are_drawn_and_the_matrix_is_a_picture(tmp_path: Path) -> None:
    seen = drawn_photos()
    for one in seen:
        cv2.imwrite(str(tmp_path / one.photo.path), np.full((700, 800, 3), 90, np.uint8))
    verdicts = judge_all(seen, PublishedJudge())
    assert write_errors(verdicts, seen, tmp_path, tmp_path / "errors") == 0
    mislabelled = [SeenPhoto(photo=Photo(path="1.png", label="2"), hands=seen[1].hands)]
    wrong = judge_all(mislabelled, PublishedJudge())
    assert write_errors(wrong, mislabelled, tmp_path, tmp_path / "errors") == 1
    drawn = cv2.imread(str(tmp_path / "errors" / "2_as_1_1.png"))
    assert drawn is not None
    assert len(np.unique(drawn.reshape(-1, 3), axis=0)) > 5
    write_confusion({"published": measure(verdicts)}, tmp_path / "confusion.png")
    assert cv2.imread(str(tmp_path / "confusion.png")) is not None
