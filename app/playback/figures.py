"""Hand and legs in a frame of a film."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from app.ipc.states import ACTION_OF
from app.motion.wearer import LEFT, RIGHT, Point, sole_point, surface_m
from app.playback import pen
from app.playback.moment import Moment, Points
from app.playback.pen import Box, Image
from app.playback.view import Figure
from app.text.catalogue import render, tr
from hal.joints.scene import BlockKind
from kgdfa.draw import LINES

HAND_PX_M = 1150.0
TEXT_HEIGHT_PX = 56  # below the hand
TRUNK_OF_STATURE, HEAD_OF_STATURE = 0.29, 0.065  # hip to shoulder, and the head's radius
HEAD_ABOVE_HIP = 0.39  # its middle, of the stature
PITCH_STEP_RAD = 0.05


def draw_hand(image: Image, place: Box, moment: Moment) -> None:
    """Skeleton, gesture, and why."""
    box, report = pen.panel(image, place, tr("film.hand")), moment.report
    if moment.picture_jpeg:
        _picture(image, box, moment)
    elif moment.hand_m is not None:
        _skeleton(image, box, moment.hand_m)
    y = box.bottom - 30
    if report is None:
        pen.write(image, (box.x + 4, y), tr("gesture.waiting"), pen.MUTED)
        return
    if report.gesture is not None:
        x = pen.write(image, (box.x + 4, y), tr(report.gesture), pen.TEXT, pen.LARGE, weight=pen.BOLD)
        pen.write(image, (x + 12, y), tr(ACTION_OF[report.gesture]), pen.ACCENT)
    else:
        named = "gesture.refused" if report.hand_refusal else "gesture.none" if report.hand else "gesture.no_hand"
        pen.write(image, (box.x + 4, y), tr(named), pen.MUTED)
    if report.hand:
        pen.write(image, (box.right - 2, y), f"{report.confidence:.0%}", pen.MUTED, right=True)
    why = report.hand_refusal or report.explanation
    if why is not None:
        pen.write(image, (box.x + 4, y + 24), pen.cut(render(why), box.width - 8, pen.SMALL), pen.MUTED, pen.SMALL)


def _picture(image: Image, box: Box, moment: Moment) -> None:
    """The camera's image with the keypoints on it, above the words."""
    picture = decoded(moment.picture_jpeg)
    height, width = picture.shape[:2]
    scale = min(box.width / width, (box.height - TEXT_HEIGHT_PX) / height)
    size = (round(width * scale), round(height * scale))
    left, top = box.x + (box.width - size[0]) // 2, box.y
    image[top : top + size[1], left : left + size[0]] = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    if moment.hand_share is not None:
        points = np.array([left, top]) + moment.hand_share * size[0]
        for line in LINES:
            pen.lines(image, points[line], pen.TEXT, 1)
        for x, y in points.tolist():
            pen.disc(image, (x, y), 2.5, pen.ACCENT)


@lru_cache(maxsize=2)  # a picture stands for several frames
def decoded(jpeg: bytes) -> Image:
    """(height, width, 3) BGR; black where the bytes are no image."""
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    return np.zeros((9, 16, 3), np.uint8) if picture is None else np.asarray(picture, np.uint8)


def _skeleton(image: Image, box: Box, hand_m: Points) -> None:
    """To scale, about its own middle; a joint nearer to the camera is larger."""
    middle = (hand_m.min(axis=0) + hand_m.max(axis=0)) / 2
    centre = np.array([box.x + box.width / 2, box.y + (box.height - TEXT_HEIGHT_PX) / 2])
    points = centre + (hand_m - middle)[:, :2] * HAND_PX_M
    for line in LINES:
        pen.lines(image, points[line], pen.TEXT, 2)
    for point, near_m in zip(points, -(hand_m - middle)[:, 2], strict=True):
        pen.disc(image, (point[0], point[1]), 4.5 + 40 * float(near_m), pen.ACCENT)


def draw_legs(image: Image, place: Box, legs: Figure | None) -> None:
    """The wearer from the side, and what stands around."""
    box = pen.panel(image, place, tr("film.legs"))
    if legs is None:
        pen.write(image, (box.x + 4, box.y + 20), tr("joints.waiting"), pen.MUTED)
        return
    body, pose, scene = legs.body, legs.pose, legs.scene
    part = image[box.y : box.bottom, box.x : box.right]  # what stands outside is cut off
    low_m = min(0.0, scene.floor_m)
    scale = (box.height - 34) / (body.stature_m * 1.02 + 0.1 - low_m)

    def at(point: Point) -> tuple[float, float]:
        return box.width / 2 + (point[0] - pose.hip[0]) * scale, box.height - 28 - (point[1] - low_m) * scale

    across_m = np.arange(box.width) / scale + pose.hip[0] - box.width / 2 / scale
    pen.lines(part, [at((x, surface_m(scene, x))) for x in across_m.tolist()], pen.EDGE, 2)
    for block in scene.blocks:
        if block.kind is BlockKind.CHAIR:
            edge = [(block.from_x_m, 2 * block.top_m), (block.from_x_m, 0.0)]
            seat = [(block.from_x_m, block.top_m), (block.to_x_m, block.top_m), (block.to_x_m, 0.0)]
            for shape in (edge, seat):
                pen.lines(part, [at(point) for point in shape], pen.EDGE, 3)
    up = np.array([np.sin(pose.lean_rad), np.cos(pose.lean_rad)])
    hip = np.array(pose.hip)
    shoulder, head = (hip + up * body.stature_m * share for share in (TRUNK_OF_STATURE, HEAD_ABOVE_HIP))
    pen.lines(part, [at(pose.hip), at((shoulder[0], shoulder[1]))], pen.MUTED, 8)
    pen.disc(part, at((head[0], head[1])), HEAD_OF_STATURE * body.stature_m * scale, pen.MUTED)
    for side in (LEFT, RIGHT):
        colour = (pen.LEFT_LEG, pen.RIGHT_LEG)[side]
        ankle, pitch = pose.ankles[side], pose.pitch_rad[side]
        toe = sole_point(ankle, body.toe_m, body.ankle_height_m, pitch)
        while pitch < 0.0 and toe[1] < surface_m(scene, toe[0]):  # the ankle gives way to the floor
            pitch = min(0.0, pitch + PITCH_STEP_RAD)
            toe = sole_point(ankle, body.toe_m, body.ankle_height_m, pitch)
        sole = [sole_point(ankle, -body.heel_m, body.ankle_height_m, pitch), toe]
        pen.lines(part, [at(pose.hip), at(pose.knees[side]), at(ankle)], colour, 7 if pose.carries[side] else 4)
        pen.lines(part, [at(ankle), at(sole[0]), at(sole[1]), at(ankle)], colour, 2)
        for joint in (pose.hip, pose.knees[side]):
            pen.disc(part, at(joint), 5, pen.TEXT)
        text = f"{tr('figure.left' if side == LEFT else 'figure.right')}{' ▪' if pose.carries[side] else ''}"
        pen.write(image, (box.x + 6 + 40 * side, box.bottom - 4), text, colour, weight=pen.BOLD)
