"""The last seconds in a frame of a film: joints, distance."""

from __future__ import annotations

from math import degrees, isfinite

import cv2
import numpy as np

from app.ipc.states import ACTION_OF
from app.playback import pen
from app.playback.pen import Box, Image
from app.playback.view import WINDOW_S, View
from app.text.catalogue import tr
from hal.joints.device import Joint
from logs import records as r
from logs.records import Record

LEAST_SPAN_DEG, MARGIN_DEG = 20.0, 3.0
FAR_M = 0.70  # the paper's farthest


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
