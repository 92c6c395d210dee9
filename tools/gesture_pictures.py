"""Draws docs/pictures/gestures.jpg and refused.jpg: the digital hand's poses as the robust rules see them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer

from app.evaluate.digital import HELD_FRAMES
from app.evaluate.harness import FRAME_NS
from app.system.config import load_config
from app.system.hand_model import find_model
from app.system.paths import find_home
from app.text.catalogue import render as text
from hal.cameras.digital_hand.render import person_of, posed, render
from hal.cameras.digital_hand.skeleton import GESTURES, LOOK_ALIKES, Pose
from kgdfa.draw import caption, draw_hand
from kgdfa.hand import Hand
from kgdfa.keypoints import HandDetector
from kgdfa.preprocess import Image
from kgdfa.robust import RobustRules

PICTURES = Path(__file__).resolve().parents[1] / "docs" / "pictures"
COLUMNS = 4
SIDE_PX = 560  # of the square cut from the middle of the frame
TILE_PX = 380


def main(
    home: Annotated[Path | None, typer.Option("--home", help="Data directory.")] = None,
    seed: Annotated[int, typer.Option(help="Whose hand.")] = 7,
) -> None:
    """Both pictures, looked at by the real detector."""
    place = find_home(home)
    rules = RobustRules()
    PICTURES.mkdir(parents=True, exist_ok=True)
    with HandDetector(find_model(place, load_config(place.config))) as detector:
        for name, poses in (("gestures", GESTURES), ("refused", LOOK_ALIKES)):
            tiles = [_tile(pose, seed, detector, rules, 100 * number) for number, pose in enumerate(poses, start=1)]
            cv2.imwrite(str(PICTURES / f"{name}.jpg"), _sheet(tiles), [cv2.IMWRITE_JPEG_QUALITY, 82])


def _tile(pose: Pose, seed: int, detector: HandDetector, rules: RobustRules, first: int) -> Image:
    image = render(posed(pose.name, person=person_of(seed), position_m=(0.0, 0.03, 0.30)), seed).image_bgr
    hands: tuple[Hand, ...] = ()
    for number, shown in enumerate((np.zeros_like(image), *[image] * HELD_FRAMES)):
        hands = detector.detect(shown, (first + number) * FRAME_NS)
    drawn = image.copy()
    why = "no hand found"
    if hands:
        draw_hand(drawn, hands[0])
        why = text(rules.classify(hands[0]).explanation)
    top, left = (image.shape[0] - SIDE_PX) // 2, (image.shape[1] - SIDE_PX) // 2
    square = drawn[top : top + SIDE_PX, left : left + SIDE_PX]
    return caption(np.asarray(cv2.resize(square, (TILE_PX, TILE_PX)), np.uint8), [f"shown: {pose.name}", why])


def _sheet(tiles: list[Image]) -> Image:
    blank = np.zeros_like(tiles[0])
    padded = [*tiles, *[blank] * (-len(tiles) % COLUMNS)]
    rows = [np.hstack(padded[k : k + COLUMNS]) for k in range(0, len(padded), COLUMNS)]
    return np.asarray(np.vstack(rows), np.uint8)


if __name__ == "__main__":
    typer.run(main)
