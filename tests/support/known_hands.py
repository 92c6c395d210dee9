"""The digital hand as a detector without errors gives it."""

from __future__ import annotations

from hal.cameras.digital_hand.raycast import project_px
from hal.cameras.digital_hand.render import Scene, keypoints_m
from kgdfa.hand import Hand, Side


def known_hand(scene: Scene, *, tracked: bool = False) -> Hand | None:
    """The hand of a scene, if it has one."""
    joints = keypoints_m(scene)
    if joints is None:
        return None
    return Hand(
        image_px=project_px(joints, scene.lens),
        world_m=joints - joints.mean(axis=0),
        presence=0.9,
        side=Side.LEFT if scene.person.shape.left else Side.RIGHT,
        tracked=tracked,
    )
