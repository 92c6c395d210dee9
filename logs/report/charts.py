"""The report's drawings as SVG: lanes over time, joints against their targets, spreads, comparisons.

Drawn here because they must print in grey, carry their text as text, and stay small on a page of half an hour.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from markupsafe import Markup, escape

from logs.read import Outline
from logs.reason import sanitize_terminal
from logs.report.data import Band, JointTrace, ReportData, Spread
from logs.show import UNKNOWN

Wording = Callable[..., str]  # a key of the catalogues, with values, as text
WIDTH = 960.0
LEFT = 84.0  # of the lanes' names
SHADES = 6  # of states, the longest first; the style sheet names them
RIGHT = 26.0  # half a tick's text
MOST_POINTS = 480  # of a line: two pixels each


def timeline(data: ReportData, t: Wording) -> Markup:
    """States, gestures, presses and events over the whole session."""
    shades = {state: f"state s{number % SHADES}" for number, (state, _) in enumerate(data.time_in_state)}
    lanes: tuple[tuple[str, Sequence[Band], Callable[[int, Band], str]], ...] = (
        ("state", data.states, lambda _, band: shades[band.label]),
        ("gesture", data.gestures, lambda number, _: "gesture odd" if number % 2 else "gesture even"),
        ("pressed", data.presses, lambda *_: "press"),
        ("events", _event_bands(data), lambda *_: "event"),
    )
    x = _scale(data.outline.duration_s)
    parts = [_axis(data.outline.duration_s, x, 4 * 28.0 + 6)]
    for row, (name, bands, style) in enumerate(lanes):
        top = row * 28.0 + 4
        parts.append(_text(LEFT - 8, top + 14, t(f"report.{name}"), "lane", "end"))
        for number, band in enumerate(bands):
            label = t("report.state_name", state=band.label) if name == "state" else band.label
            parts.append(_band(band, label, x, top, style(number, band)))
    parts += [
        Markup('<path class="stop" d="M{0:.1f} 0v116"><title>{1}</title></path>').format(
            x(at_s), t("report.stop_at", at=clock(at_s))
        )
        for at_s in data.stops_s
    ]
    return _svg(parts, 4 * 28.0 + 28, t("report.timeline_title"))


def joint(trace: JointTrace, duration_s: float, t: Wording) -> Markup:
    """One joint's angle (band from lowest to highest of each second, line of the mean) against its target."""
    if not trace.at_s:
        return Markup("")
    height = 110.0
    x = _scale(duration_s)
    everything = [*trace.low_deg, *trace.high_deg, *trace.target_deg]
    finite = [value for value in everything if math.isfinite(value)]
    low, high = min(finite), max(finite)
    y = _vertical(low, high, height)
    top = _thin(trace.at_s, trace.high_deg)
    bottom = _thin(trace.at_s, trace.low_deg)
    outline = [*top, *reversed(bottom)]
    parts = [
        _axis(duration_s, x, height + 6),
        _text(LEFT - 8, 14, f"{high:.0f}°", "tick", "end"),
        _text(LEFT - 8, height, f"{low:.0f}°", "tick", "end"),
        _text(LEFT - 8, height / 2 + 5, t(trace.name), "lane", "end"),
        Markup('<path class="range" d="{}Z"/>').format(_path(outline, x, y)),
        Markup('<path class="target" d="{}"/>').format(_path(_thin(trace.at_s, trace.target_deg), x, y)),
        Markup('<path class="mean" d="{}"/>').format(_path(_thin(trace.at_s, trace.mean_deg), x, y)),
    ]
    return _svg(parts, height + 26, t("report.joint_title", joint=t(trace.name)))


def spreads(found: Sequence[Spread], t: Wording) -> Markup:
    """Each latency as a row of strokes with its median marked."""
    longest = max((value for spread in found for value in spread.values_ms), default=0.0)
    if longest <= 0:
        return Markup("")
    left = 250.0

    def x(value: float) -> float:
        return left + value / longest * (WIDTH - left - 20)

    parts = []
    for row, spread in enumerate(found):
        top = row * 30.0 + 6
        parts.append(_text(left - 10, top + 15, t(spread.name), "lane", "end"))
        strokes = "".join(f"M{x(value):.1f} {top:.0f}v18" for value in spread.values_ms)
        parts.append(Markup('<path class="strokes" d="{}"/>').format(strokes))
        if (median := spread.share(0.5)) is not None:
            parts.append(Markup('<path class="median" d="M{0:.1f} {1:.0f}v26"/>').format(x(median), top - 4))
    bottom = len(found) * 30.0 + 18
    ticks = [value for value in _nice_steps(longest) if value <= longest]
    parts += [_text(x(value), bottom, f"{value:g} ms", "tick", "middle") for value in ticks]
    return _svg(parts, bottom + 8, t("report.latencies_title"))


def earlier(sessions: Sequence[Outline], t: Wording) -> Markup:
    """Steps, distance and refusals of this patient's sessions, the newest at the right."""
    rows: tuple[tuple[str, Callable[[Outline], float | None], str], ...] = (
        (t("report.steps"), lambda each: each.steps, "{:.0f}"),
        (t("report.metres"), lambda each: each.distance_m, "{:.1f}"),
        (t("report.refusals"), lambda each: each.refusals, "{:.0f}"),
    )
    slot = (WIDTH - LEFT) / max(len(sessions), 1)
    bar = min(slot * 0.6, 60)
    parts = []
    for row, (name, value_of, form) in enumerate(rows):
        base = (row + 1) * 80.0
        values = [value_of(each) for each in sessions]
        most = max([*(value for value in values if value is not None), 1.0])
        parts.append(_text(LEFT - 8, base - 4, name, "lane", "end"))
        for place, (each, value) in enumerate(zip(sessions, values, strict=True)):
            centre = LEFT + slot * (place + 0.5)
            height = (value or 0.0) / most * 54
            style = "bar now" if place == len(sessions) - 1 else "bar"
            parts.append(
                Markup(
                    '<rect class="{}" x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}"><title>{}</title></rect>'
                ).format(style, centre - bar / 2, base - height, bar, height, each.began[:16].replace("T", " "))
            )
            number = UNKNOWN if value is None else form.format(value)
            parts.append(_text(centre, base - height - 4, number, "tick", "middle"))
    for place, each in enumerate(sessions):
        parts.append(_text(LEFT + slot * (place + 0.5), 256, each.began[5:10], "tick", "middle"))
    return _svg(parts, 264, t("report.earlier_title"))


def clock(at_s: float) -> str:
    """Minutes and seconds."""
    minutes, seconds = divmod(round(at_s, 1), 60)
    return f"{minutes:.0f}:{seconds:04.1f}"


def _event_bands(data: ReportData) -> list[Band]:
    end_s = data.outline.duration_s
    return [
        Band(
            begin_s=event.at_s,
            end_s=event.at_s + event.lasted_within_s(end_s),
            label=f"{event.event} ({event.effect})",
        )
        for event in data.events
    ]


def _scale(duration_s: float) -> Callable[[float], float]:
    whole = max(duration_s, 1e-9)
    return lambda at_s: LEFT + min(max(at_s / whole, 0.0), 1.0) * (WIDTH - LEFT - RIGHT)


def _vertical(low: float, high: float, height: float) -> Callable[[float], float]:
    span = max(high - low, 1e-9)
    return lambda value: 4 + (high - value) / span * (height - 8)


def _band(band: Band, text: str, x: Callable[[float], float], top: float, style: str) -> Markup:
    left, right = x(band.begin_s), x(band.end_s)
    width = max(right - left, 1.5)
    label = sanitize_terminal(text)
    title = f"{label}, {clock(band.begin_s)} – {clock(band.end_s)}"
    shape = Markup('<rect class="{}" x="{:.1f}" y="{:.1f}" width="{:.1f}" height="20"><title>{}</title></rect>').format(
        style, left, top, width, title
    )
    if width < 7.0 * len(label):
        return shape
    return shape + _text(left + 3, top + 14, label, "inside", "start")


def _axis(duration_s: float, x: Callable[[float], float], bottom: float) -> Markup:
    unit_s, unit = (60.0, "min") if duration_s > 120 else (1.0, "s")
    parts = [
        Markup('<path class="grid" d="M{0:.1f} 0V{1:.1f}"/>').format(x(at_s), bottom)
        + _text(x(at_s), bottom + 14, f"{at_s / unit_s:g} {unit}", "tick", "middle")
        for at_s in _nice_steps(duration_s, unit_s)
    ]
    return Markup("").join(parts)


def _nice_steps(most: float, unit: float = 1.0) -> list[float]:
    """Six to twelve round numbers from zero, in units that people count in."""
    rough = max(most / unit, 1e-9) / 8
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= rough) * unit
    return [step * count for count in range(int(most / step + 1e-9) + 1)]


def _thin(at_s: Sequence[float], values: Sequence[float]) -> list[tuple[float, float]]:
    """Not more points than the paper can show, extremes kept: of each group the value farthest from its mean."""
    points = [(t, v) for t, v in zip(at_s, values, strict=True) if math.isfinite(v)]
    group = max(len(points) // MOST_POINTS, 1)
    return [_farthest(points[first : first + group]) for first in range(0, len(points), group)]


def _farthest(points: list[tuple[float, float]]) -> tuple[float, float]:
    mean = sum(value for _, value in points) / len(points)
    return max(points, key=lambda point: abs(point[1] - mean))


def _path(points: Sequence[tuple[float, float]], x: Callable[[float], float], y: Callable[[float], float]) -> str:
    return "M" + "L".join(f"{x(at_s):.1f} {y(value):.1f}" for at_s, value in points)


def _text(x: float, y: float, text: str, style: str, anchor: str) -> Markup:
    return Markup('<text class="{}" x="{:.1f}" y="{:.1f}" text-anchor="{}">{}</text>').format(
        style, x, y, anchor, sanitize_terminal(text)
    )


def _svg(parts: Sequence[Markup], height: float, title: str) -> Markup:
    return Markup('<svg viewBox="0 0 {:.0f} {:.0f}" role="img"><title>{}</title>{}</svg>').format(
        WIDTH, height, escape(sanitize_terminal(title)), Markup("").join(parts)
    )
