"""What the replay screen draws beside the session's own panels: hand, curves over time, the time bar. Pure."""

from __future__ import annotations

from itertools import pairwise
from math import degrees, isfinite
from typing import TYPE_CHECKING

import cv2
import numpy as np

from app.console.state import NO_NOTE, READABLE_NS, PressNote
from app.console.widgets.canvas import Canvas
from app.console.widgets.curves import Curves
from app.console.widgets.gesture import why_nothing
from app.console.widgets.halfblock import fit, to_strips
from app.console.widgets.panel import Line, Lines, cells, fitted, plain
from app.console.widgets.push import Push
from app.ipc.messages import TriggerReport
from app.playback.panels import decoded
from app.playback.session import Playback, moment_ns
from app.playback.view import WINDOW_S, clock
from app.text.catalogue import tr
from kgdfa.draw import LINES
from logs import records as r
from logs.records import Record
from logs.show import WEIGHT

if TYPE_CHECKING:
    from app.playback.moment import Points
    from app.recording.index import JointSamples

HAND_M = 0.21  # across the drawing's height: an open hand
PALM, FINGERS = "bold $primary", "$foreground"
CURVE_POINTS = 150  # finer than the dots of the widest panel need
MARKS = {"grave": ("■", "bold $error"), "caution": ("▲", "$warning"), "action": ("│", "$accent"), "": ("·", "")}


def draw_skeleton(hand_m: Points | None, columns: int, rows: int) -> Lines:
    """The 21 keypoints to scale, about their own middle."""
    if hand_m is None:
        return (plain(tr("gesture.no_hand"), "$foreground-muted"),)
    canvas = Canvas(columns, rows)
    scale = min(canvas.width, canvas.height) / HAND_M
    middle = (hand_m.min(axis=0) + hand_m.max(axis=0)) / 2
    points = [
        (canvas.width / 2 + float(x) * scale, canvas.height / 2 + float(y) * scale)
        for x, y, _ in (hand_m - middle).tolist()
    ]
    for line in LINES:
        canvas.pen = PALM if 0 in line else FINGERS
        for a, b in pairwise(line.tolist()):
            canvas.bold_line(*points[a], *points[b])
    return canvas.lines()


def draw_picture(jpeg: bytes, columns: int, rows: int) -> Lines:
    """The camera's image in half blocks, undistorted; () where there is no room."""
    if columns < 4 or rows < 2:
        return ()
    picture = decoded(jpeg)
    size = fit(picture.shape[1], picture.shape[0], columns, rows)
    small = cv2.cvtColor(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2RGB)
    strips = to_strips(np.asarray(small, np.uint8))
    return tuple(tuple((segment.text, str(segment.style)) for segment in strip) for strip in strips)


def curves_of(measured: JointSamples, commanded: JointSamples, until_ns: int) -> Curves:
    """The last seconds as the joints' panel draws a step: the share of the window instead of the plan's."""
    curves = Curves()
    count = min(len(measured.at_ns), len(commanded.at_ns))
    begin_ns = until_ns - WINDOW_S * 1e9
    for row in range(count % max(1, count // CURVE_POINTS), count, max(1, count // CURVE_POINTS)):
        angles, targets = measured.values[row, 0].tolist(), commanded.values[row, 0].tolist()
        if all(map(isfinite, (*angles, *targets))):
            share = (int(measured.at_ns[row]) - begin_ns) / (WINDOW_S * 1e9)
            curves.points.append((share, tuple(map(degrees, angles)), tuple(map(degrees, targets))))
    return curves


def push_of(reports: list[TriggerReport], landmarks: list[Record]) -> Push:
    """The push of the last seconds, with why one gave nothing as the trail says it."""
    push = Push()
    for report in reports:
        push.take(report, why_nothing(note_at(landmarks, report.captured_ns)))
    return push


def note_at(landmarks: list[Record], at_ns: int) -> PressNote:
    """Why the newest push gave nothing, while the console would show it."""
    for one in reversed(landmarks):
        when_ns, body = moment_ns(one), one.body
        if when_ns > at_ns:
            continue
        if isinstance(body, r.Press) or at_ns - when_ns > READABLE_NS:
            break
        if isinstance(body, r.Cancel | r.Hint) and not isinstance(body.reason, str) and body.reason is not None:
            return PressNote(reason=body.reason, cancelled=isinstance(body, r.Cancel), since_ns=when_ns)
    return NO_NOTE


def time_bar(playback: Playback, at_ns: int, width: int) -> Line:
    """The whole recording, what happened in it, and the moment shown."""
    cells_of: list[tuple[str, str]] = [("─", "$foreground-muted")] * width
    rank = {mark: number for number, mark in enumerate(("", "action", "caution", "grave"))}
    best = [-1] * width
    for one in playback.landmarks.between(playback.begin_ns - 1, playback.end_ns):
        place = _place(playback, moment_ns(one), width)
        weight = WEIGHT.get(type(one.body), "")
        if rank.get(weight, 0) > best[place]:
            best[place], cells_of[place] = rank.get(weight, 0), MARKS.get(weight, MARKS[""])
    cells_of[_place(playback, at_ns, width)] = ("●", "bold $primary")
    return tuple(cells_of)


def _place(playback: Playback, at_ns: int, width: int) -> int:
    share = (at_ns - playback.begin_ns) / max(playback.end_ns - playback.begin_ns, 1)
    return min(max(int(share * width), 0), width - 1)


def replay_status(playback: Playback, at_ns: int, speed: float, *, playing: bool, width: int) -> Line:
    """Playing or not, how fast, when, and of which session; what is needed most is kept longest."""
    mark = (f" {'▶' if playing else '■'} ×{speed:g} ", "bold reverse $primary")
    now = (f" {clock(playback.seconds(at_ns))} / {clock(playback.duration_s, 0)} ", "bold")
    record = playback.landmarks.newest(at_ns)
    number = (f" #{record.sequence} " if record is not None else "", "$accent")
    title = (f" {tr('replay.title')} ", "bold reverse $accent")
    line = fitted([title, mark, now, number, (f" {playback.name} ", "$foreground-muted")], width)
    return (*line, (" " * max(0, width - sum(cells(text) for text, _ in line)), ""))
