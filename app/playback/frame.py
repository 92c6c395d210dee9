"""One frame of a film: hand, legs, joints, distance, gait and events at a moment. Drawn from values alone."""

from __future__ import annotations

from datetime import UTC, datetime

import cv2
import numpy as np

from app.ipc.states import Effect
from app.playback import pen
from app.playback.panels import draw_hand, draw_joints, draw_legs, draw_push
from app.playback.pen import Box, Image
from app.playback.view import WINDOW_S, View, Whole, clock
from app.text.catalogue import render, tr
from app.text.recorded import render_recorded
from logs.reason import sanitize_terminal
from logs.show import WEIGHT, record_text

WIDTH_PX, HEIGHT_PX = 1280, 720
HAND, LEGS, JOINTS = Box(12, 52, 400, 322), Box(420, 52, 440, 322), Box(868, 52, 400, 486)
PUSH, GAIT = Box(12, 382, 400, 156), Box(420, 382, 440, 156)
LANDMARKS, BAR = Box(12, 546, 1256, 142), Box(12, 696, 1256, 14)
ROW_PX = 20
COLOURS = {"grave": pen.BAD, "caution": pen.WARN, "action": pen.ACCENT, "faint": pen.MUTED}


def draw(view: View, whole: Whole) -> Image:
    """The frame, (720, 1280, 3) BGR."""
    image: Image = np.full((HEIGHT_PX, WIDTH_PX, 3), pen.GROUND, dtype=np.uint8)
    _head(image, view, whole)
    draw_hand(image, HAND, view.moment)
    draw_legs(image, LEGS, view.legs)
    draw_joints(image, JOINTS, view)
    draw_push(image, PUSH, view)
    _gait(image, view)
    _landmarks(image, view, whole)
    _bar(image, view, whole)
    return image


def _head(image: Image, view: View, whole: Whole) -> None:
    at_ns, snapshot = view.moment.at_ns, view.moment.snapshot
    wall = datetime.fromtimestamp((at_ns + whole.clock_offset_ns) / 1e9, UTC)
    x = pen.write(image, (14, 30), whole.session, pen.TEXT, pen.NORMAL, weight=pen.BOLD)
    pen.write(image, (x + 18, 30), tr("film.patient", patient=whole.patient), pen.MUTED)
    if snapshot is not None and snapshot.effect >= Effect.REFUSE:
        colour = pen.BAD if snapshot.effect >= Effect.HOLD else pen.WARN
        text = tr(snapshot.effect).upper()
        width = pen.text_width(text, pen.NORMAL, pen.BOLD)
        cv2.rectangle(image, (640 - width // 2 - 12, 8), (640 + width // 2 + 12, 38), colour, -1)
        pen.write(image, (640 - width // 2, 29), text, pen.GROUND, weight=pen.BOLD)
    seconds, whole_s = (at_ns - whole.begin_ns) / 1e9, (whole.end_ns - whole.begin_ns) / 1e9
    speed = "" if whole.speed == 1.0 else f"  ×{whole.speed:g}"
    x = WIDTH_PX - 14
    x -= pen.text_width(f" / {clock(whole_s, 0)}{speed}")
    pen.write(image, (x, 30), f" / {clock(whole_s, 0)}{speed}", pen.MUTED)
    x -= pen.text_width(clock(seconds), pen.LARGE, pen.BOLD)
    pen.write(image, (x, 31), clock(seconds), pen.TEXT, pen.LARGE, weight=pen.BOLD)
    pen.write(
        image, (x - 18, 30), f"{wall:%Y-%m-%d %H:%M:%S}.{wall.microsecond // 10000:02d} UTC", pen.MUTED, right=True
    )


def _gait(image: Image, view: View) -> None:
    box, snapshot = pen.panel(image, GAIT, tr("film.gait")), view.moment.snapshot
    if snapshot is None:
        pen.write(image, (box.x + 4, box.y + 20), tr("machine.waiting"), pen.MUTED)
        return
    pen.write(image, (box.x + 4, box.y + 22), f"● {tr(snapshot.state)}", pen.TEXT, pen.NORMAL, weight=pen.BOLD)
    armed = tr("status.armed" if snapshot.armed else "status.not_armed")
    pen.write(
        image, (box.right - 4, box.y + 22), armed, pen.GOOD if snapshot.armed else pen.WARN, pen.SMALL, right=True
    )
    if snapshot.action is not None:
        pending = f"  {tr('machine.pending', action=tr(snapshot.pending))}" if snapshot.pending else ""
        running = pen.cut(f"▶ {tr(snapshot.action)}{pending}", box.width - 70)
        pen.write(image, (box.x + 4, box.y + 50), running, pen.ACCENT, weight=pen.BOLD)
        pen.write(image, (box.right - 4, box.y + 50), f"{snapshot.progress:.0%}", pen.ACCENT, right=True)
        left, right, y = box.x + 4, box.right - 4, box.y + 62
        cv2.rectangle(image, (left, y), (right, y + 8), pen.EDGE, -1)
        cv2.rectangle(
            image, (left, y), (left + round((right - left) * min(snapshot.progress, 1.0)), y + 8), pen.ACCENT, -1
        )
    figures = f"{tr('health.steps')} {snapshot.steps}   {tr('health.distance')} {snapshot.distance_walked_m:.1f} m"
    pen.write(image, (box.x + 4, box.y + 92), figures, pen.TEXT, pen.SMALL)
    active = [one for one in snapshot.events if one.present and one.effect > Effect.NOTE]
    for event in sorted(active, key=lambda one: -one.effect)[:1]:
        colour = pen.BAD if event.effect >= Effect.HOLD else pen.WARN
        pen.write(
            image, (box.x + 4, box.y + 114), pen.cut(render(event.reason), box.width - 8, pen.SMALL), colour, pen.SMALL
        )


def _landmarks(image: Image, view: View, whole: Whole) -> None:
    """The newest below."""
    box = pen.panel(image, LANDMARKS, tr("film.happened"))
    rows = box.height // ROW_PX
    for row, (when_ns, record) in enumerate(view.landmarks[-rows:]):
        y = box.y + 14 + row * ROW_PX
        age_s = (view.moment.at_ns - when_ns) / 1e9
        colour = COLOURS.get(WEIGHT.get(type(record.body), ""), pen.TEXT)
        if age_s > WINDOW_S:
            colour = pen.MUTED
        pen.write(image, (box.x + 64, y), clock((when_ns - whole.begin_ns) / 1e9), pen.MUTED, pen.SMALL, right=True)
        pen.write(image, (box.x + 112, y), f"#{record.sequence}", pen.MUTED, pen.SMALL, right=True)
        text = sanitize_terminal(record_text(record.body, render_recorded))
        pen.write(image, (box.x + 122, y), pen.cut(text, box.width - 126, pen.SMALL), colour, pen.SMALL)


def _bar(image: Image, view: View, whole: Whole) -> None:
    """The whole recording, its events, and where this frame is."""
    duration_s = max((whole.end_ns - whole.begin_ns) / 1e9, 1e-9)
    cv2.rectangle(image, (BAR.x, BAR.y + 5), (BAR.right, BAR.y + 9), pen.EDGE, -1)
    for at_s, weight in whole.marks:
        x = BAR.x + round(at_s / duration_s * BAR.width)
        cv2.line(image, (x, BAR.y + 2), (x, BAR.y + 12), COLOURS.get(weight, pen.MUTED), 1)
    x = BAR.x + round((view.moment.at_ns - whole.begin_ns) / 1e9 / duration_s * BAR.width)
    pen.disc(image, (x, BAR.y + 7), 7, pen.TEXT)
