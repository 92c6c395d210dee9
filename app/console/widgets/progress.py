"""A patient's measures over sessions: figures, a plot, and the smallest change that means something. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from app.console.widgets.canvas import Canvas
from app.console.widgets.panel import Line, Lines, cells, fitted, padded, plain
from app.outcomes.table import Series
from app.text.catalogue import tr

ROWS = 2  # of a plot
LEAST_WIDTH = 24  # of a plot with its labels


def progress_lines(measures: Sequence[Series], width: int) -> Lines:
    """Each measure below the other: name and figures, what its change means, its plot."""
    lines: list[Line] = []
    for series in measures:
        lines.extend(_figures(series, width))
        if series.smallest is not None:
            lines.append(_meaning(series, width))
        if width >= LEAST_WIDTH and len(series.values) > 1:
            lines.extend(plot(series, width))
        lines.append(plain(""))
    return tuple(lines)


def plot(series: Series, width: int) -> Lines:
    """A point a session, joined where two follow each other; dotted: the smallest change, up and down from the first.

    The scale's ends stand before it. No measure is negative, so a dotted line below 0 is left out.
    """
    around = [] if series.least is None else [series.known[0] - series.least, series.known[0] + series.least]
    dotted = [line for line in around if line >= 0]
    shown = [*series.known, *dotted]
    bottom, top = min(shown), max(shown)
    labels = (format(top, series.form), format(bottom, series.form))
    if top == bottom:  # in the middle
        bottom, top = bottom - 1, top + 1
    axis = max(map(cells, labels)) + 1
    canvas = Canvas(width, ROWS)

    def at(number: int, value: float) -> tuple[float, float]:
        share = number / (len(series.values) - 1)
        return 2 * axis + share * (canvas.width - 1 - 2 * axis), (top - value) / (top - bottom) * (canvas.height - 1)

    canvas.pen = "$accent"
    for line in dotted:
        canvas.line(*at(0, line), *at(len(series.values) - 1, line), every=4)
    canvas.pen = "bold $primary"
    points = [None if value is None else at(number, value) for number, value in enumerate(series.values)]
    for point in points:
        if point is not None:
            canvas.dot(round(point[0]), round(point[1]))
    for a, b in pairwise(points):
        if a is not None and b is not None:
            canvas.line(*a, *b)
    canvas.text(0, 0, labels[0], "$foreground-muted")
    if labels[0] != labels[1]:
        canvas.text(0, ROWS - 1, labels[1], "$foreground-muted")
    return canvas.lines()


def _figures(series: Series, width: int) -> Lines:
    """On one line, else the figures below the name."""
    known, form = series.known, series.form
    parts = [(f"{known[-1]:{form}}", "bold")]
    if series.change is not None:
        parts = [(f"{known[0]:{form}} → ", "$foreground-muted"), *parts, (f"  ({series.change:+{form}})", "")]
    name = (f"{series.name}  ", "bold")
    if sum(cells(text) for text, _ in (name, *parts)) <= width:
        return ((name, *parts),)
    return (plain(padded(series.name, min(width, cells(series.name))), "bold"), fitted(parts, width))


def _meaning(series: Series, width: int) -> Line:
    assert series.smallest is not None
    assert series.least is not None
    least = f"±{series.least:{series.form}}"
    kind = tr(series.smallest.kind)
    if series.change is None:
        return fitted([(tr("outcomes.page.smallest", change=kind, least=least), "$foreground-muted")], width)
    reached = abs(series.change) >= series.least
    code = "outcomes.page.reached" if reached else "outcomes.page.not_reached"
    return fitted([(tr(code, change=kind, least=least), "bold $success" if reached else "$foreground-muted")], width)
