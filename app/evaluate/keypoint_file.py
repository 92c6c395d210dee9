"""Keypoints of looked-at photos in one file, so that fitting and measuring again need no detector."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.evaluate.gesture_photos import Photo, SeenPhoto
from app.system.errors import AppError
from kgdfa.hand import Hand, Side


def save_seen(seen: list[SeenPhoto], path: Path) -> None:
    """Write every photo's hands as a compressed npz."""
    hands = [(number, hand) for number, one in enumerate(seen) for hand in one.hands]
    np.savez_compressed(
        path,
        photos=np.array([[p.photo.path, p.photo.label, p.photo.source, p.photo.group, p.error] for p in seen]),
        owner=np.array([number for number, _ in hands], dtype=np.int64),
        image_px=np.array([hand.image_px for _, hand in hands], dtype=np.float32).reshape(-1, 21, 2),
        world_m=np.array([hand.world_m for _, hand in hands], dtype=np.float32).reshape(-1, 21, 3),
        presence=np.array([hand.presence for _, hand in hands]),
        side=np.array([hand.side.value for _, hand in hands], dtype="U5"),
    )


def load_seen(path: Path, photos: list[Photo]) -> list[SeenPhoto]:
    """What `save_seen` wrote. Raises AppError when it belongs to other photos."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            file = {name: stored[name] for name in stored.files}
        seen = _photos_of(file)
    except (OSError, ValueError, KeyError) as error:
        raise AppError(f"{path} is no keypoint file ({error}): remove it, and it is made again.") from error
    if [one.photo for one in seen] != photos:
        raise AppError(f"{path} holds the keypoints of other pictures: remove it, and it is made again.")
    return seen


def _photos_of(file: dict[str, NDArray[Any]]) -> list[SeenPhoto]:
    hands: list[list[Hand]] = [[] for _ in file["photos"]]
    rows = zip(file["owner"], file["image_px"], file["world_m"], file["presence"], file["side"], strict=True)
    for owner, image_px, world_m, presence, side in rows:
        hands[owner].append(
            Hand(
                image_px=image_px.astype(np.float64),
                world_m=world_m.astype(np.float64),
                presence=float(presence),
                side=Side(str(side)),
            )
        )
    return [
        SeenPhoto(
            photo=Photo(path=str(path), label=str(label), source=str(source), group=str(group)),
            hands=tuple(own),
            error=str(error),
        )
        for (path, label, source, group, error), own in zip(file["photos"], hands, strict=True)
    ]
