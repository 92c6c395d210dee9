"""The panels of a film's frame: hand, legs, and the last seconds of joints and distance."""

from __future__ import annotations

from functools import lru_cache
from math import degrees, isfinite

import cv2
import numpy as np

from app.ipc.states import ACTION_OF
from app.motion.wearer import LEFT, RIGHT, Point, sole_point, surface_m
from app.playback import pen
from app.playback.moment import Moment, Points
from app.playback.pen import Box, Image
from app.playback.view import WINDOW_S, Figure, View
from app.text.catalogue import render, tr
from hal.joints.device import Joint
from hal.joints.scene import BlockKind
from kgdfa.draw import LINES
from logs import records as r
from logs.records import Record

HAND_PX_M = 1150.0
TEXT_HEIGHT_PX = 56  # below the hand
TRUNK_OF_STATURE, HEAD_OF_STATURE = 0.29, 0.065  # hip to shoulder, and the head's radius
HEAD_ABOVE_HIP = 0.39  # its middle, of the stature
PITCH_STEP_RAD = 0.05
LEAST_SPAN_DEG, MARGIN_DEG = 20.0, 3.0
FAR_M = 0.70  # the paper's farthest


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


def draw_joints(image: Image, place: Box, view: View) -> None:
    """Each joint's curve over its set-point, one above the other."""
    box = pen.panel(image, place, tr("film.joints", seconds=WINDOW_S))
    legend = f"{tr('film.measured')}  "
    x = box.right - 2 - pen.text_width(tr("film.setpoint"), pen.SMALL)
    pen.write(image, (x, place.y + 20), tr("film.setpoint"), pen.PLANNED, pen.SMALL)
    pen.write(image, (x, place.y + 20), legend, pen.ACCENT, pen.SMALL, right=True)
    height = box.height // len(Joint)
    for joint in Joint:
        _curve(image, Box(box.x, box.y + joint * height, box.width, height - 6), joint, view)


def _curve(image: Image, box: Box, joint: Joint, view: View) -> None:
    graph = Box(box.x + 34, box.y + 20, box.width - 36, box.height - 22)
    cv2.rectangle(image, (graph.x, graph.y), (graph.right, graph.bottom), pen.GROUND, -1)
    snapshot = view.moment.snapshot
    pen.write(image, (box.x + 2, box.y + 15), tr(joint), pen.TEXT, pen.SMALL, weight=pen.BOLD)
    if snapshot is not None and isfinite(snapshot.joints[joint].angle_rad):
        now = snapshot.joints[joint]
        figures = f"{degrees(now.angle_rad):.1f}°  {now.torque_nm:+.1f} Nm"
        pen.write(image, (box.right - 2, box.y + 15), figures, pen.TEXT, pen.SMALL, right=True)
    series = [(one.at_ns, np.degrees(one.values[:, 0, joint])) for one in (view.commanded, view.measured)]
    known = np.concatenate([values[np.isfinite(values)] for _, values in series])
    if not len(known):
        return
    middle, span = (known.min() + known.max()) / 2, max(LEAST_SPAN_DEG, np.ptp(known) + 2 * MARGIN_DEG)
    for value, y in ((middle + span / 2, graph.y + 10), (middle - span / 2, graph.bottom)):
        pen.write(image, (graph.x - 4, int(y)), f"{value:.0f}°", pen.MUTED, 12, right=True)
    for (at_ns, values), colour, width in zip(series, (pen.PLANNED, pen.ACCENT), (3, 2), strict=True):
        x = graph.right - (view.moment.at_ns - at_ns) / (WINDOW_S * 1e9) * graph.width
        y = graph.y + (middle + span / 2 - values) / span * graph.height
        drawn = np.isfinite(y)
        drawn[drawn] = np.arange(drawn.sum()) % 3 == 0  # 500 Hz is finer than a pixel
        pen.lines(image, np.stack([x, y], axis=1)[drawn], colour, width)


def draw_push(image: Image, place: Box, view: View) -> None:
    """The distance that decides, its threshold, and what came of it."""
    box, report = pen.panel(image, place, tr("film.distance", seconds=WINDOW_S)), view.moment.report
    if report is None:
        return
    if report.safe_distance_m is not None:
        figure = f"{report.safe_distance_m * 100:.1f} cm"
        pen.write(image, (box.right - 2, place.y + 20), figure, pen.TEXT, pen.NORMAL, weight=pen.BOLD, right=True)
    if report.pressed:
        x = place.x + 14 + pen.text_width(tr("film.distance", seconds=WINDOW_S), pen.SMALL)
        pen.write(image, (x + 8, place.y + 20), f"● {tr('button.pressed')}", pen.GOOD, pen.SMALL, weight=pen.BOLD)
    graph = Box(box.x, box.y + 2, box.width, box.height - 2)
    cv2.rectangle(image, (graph.x, graph.y), (graph.right, graph.bottom), pen.GROUND, -1)

    def at(when_ns: int, metres: float) -> tuple[float, float]:
        x = graph.right - (view.moment.at_ns - when_ns) / (WINDOW_S * 1e9) * graph.width
        return x, graph.bottom - min(max(metres / FAR_M, 0.0), 1.0) * graph.height

    limit = int(at(0, report.threshold_m)[1])
    pen.dashed(image, limit, graph.x, graph.right, pen.WARN)
    pen.write(image, (graph.x + 4, limit - 5), f"{report.threshold_m * 100:.0f} cm", pen.WARN, 12)
    run: list[tuple[float, float]] = []
    for one in view.reports:
        if one.safe_distance_m is None:
            pen.lines(image, run, pen.ACCENT, 2)
            run = []
        else:
            run.append(at(one.captured_ns, one.safe_distance_m))
    pen.lines(image, run, pen.ACCENT, 2)
    for when_ns, record in view.pushes:
        _mark(image, graph, at(when_ns, getattr(record.body, "safe_distance_m", None) or report.threshold_m), record)


def _mark(image: Image, graph: Box, at: tuple[float, float], record: Record) -> None:
    """A press down, a release up, what gave nothing crossed out."""
    x, y, body = round(at[0]), round(at[1]), record.body
    if x < graph.x + 6:
        return
    colour = pen.GOOD if isinstance(body, r.Press | r.Release) else pen.WARN
    if isinstance(body, r.Press | r.Release):
        tip = 7 if isinstance(body, r.Press) else -7
        shape = np.array([(x - 6, y - tip), (x + 6, y - tip), (x, y + tip)])
        cv2.fillPoly(image, [shape], colour, cv2.LINE_AA)
    else:
        pen.lines(image, [(x - 5, y - 5), (x + 5, y + 5)], colour, 2)
        pen.lines(image, [(x - 5, y + 5), (x + 5, y - 5)], colour, 2)
    if isinstance(body, r.Release) and body.gesture:
        name = next((tr(gesture) for gesture in ACTION_OF if gesture.value == body.gesture), body.gesture)
        left_of = x + 12 + pen.text_width(name, pen.SMALL) > graph.right
        pen.write(image, (x - 12 if left_of else x + 10, y + 5), name, colour, pen.SMALL, right=left_of)
