"""The page of the paper's tables: one HTML file that fetches nothing, each table with its plot and its command.

Of each table it shows the paper's figures and those that were made, from their JSON.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.evaluate.distance.table5 import FIRST_HAND as FIRST_RULER
from app.evaluate.distance.table5_results import PAPER_TABLE_5
from app.evaluate.gestures.report import PAPER_MACRO_F1, PAPER_MAP, PAPER_TABLE_3
from app.evaluate.harness import MODES, decimals, decorate, figure, require_extra, write_whole
from app.evaluate.loop.speed import BARE, PAPER_TABLE_4, WHOLE
from app.evaluate.loop.table7 import PAPER, PAPER_OVERALL
from app.evaluate.paper.make import Run, figures_file, read_as, run_file
from app.evaluate.trigger.chain import CAMERAS
from app.evaluate.trigger.table6 import FIRST_HAND, PAPER_FPS, PAPER_TABLE_6
from app.text.catalogue import language, tr

Cell = str | int | float | None
_BY_CAMERA = tuple(f"{camera}_{mode}" for camera in ("monocular", "d435i") for mode in ("paper", *MODES))
NOT_REPRODUCED = ("training", "detectors", "lite", "link", "people")  # why: in the catalogue
PAGE = "paper.html"


@dataclass(frozen=True, slots=True)
class Sheet:
    """One table of the page. series: of the plot, by their labels' keys, over the rows' first cells."""

    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    series: dict[str, list[float | None]]
    axis: str
    notes: tuple[str, ...] = ()


def _table_3(figures: dict[str, Any]) -> Sheet:
    rules = figures["rules"]
    rows: list[tuple[Cell, ...]] = []
    for gesture, (*_, f1, ap) in PAPER_TABLE_3.items():
        ours = [_percent(rules[name]["per_gesture"][gesture][key]) for key in ("f1", "ap") for name in MODES]
        rows.append((gesture, f1, *ours[:2], ap, *ours[2:]))
    means = [_percent(rules[name][key]) for key in ("macro_f1", "map") for name in MODES]
    accepted = [decimals(_percent(rules[name]["accepted_undefined"]), ".2f") for name in MODES]
    series = _series(rows, {"paper": 1, "published": 2, "robust": 3})
    last = (tr("evaluate.paper.mean"), PAPER_MACRO_F1, *means[:2], PAPER_MAP, *means[2:])
    undefined = tr("evaluate.paper.undefined", published=accepted[0], robust=accepted[1], images=figures["images"])
    columns = ("gesture", "f1_paper", "f1_published", "f1_robust", "ap_paper", "ap_published", "ap_robust")
    fitted = tr(f"evaluate.gestures.{'cross_validated' if figures['cross_validated'] else 'shipped'}")
    return Sheet(columns, (*rows, last), series, "gesture", (undefined, fitted))


def _table_4(figures: dict[str, Any]) -> Sheet:
    rows: list[tuple[Cell, ...]] = []
    for name, one in figures["detectors"].items():
        label = tr(f"evaluate.stage.{name}") if name in {WHOLE, BARE} else name
        adds = one["multiply_adds"]
        found = 100 * one["hands"] / figures["frames"]
        rows.append((label, one["parameters"] / 1e6, adds and adds / 1e9, one["ms"], 1000 / one["ms"], found))
    for name, (_, millions, frame_s, fps) in PAPER_TABLE_4.items():
        rows.append((tr("evaluate.paper_row", name=name), millions, None, 1000 * frame_s, float(fps), None))
    ratio = tr("evaluate.paper.ratio", ratio=f"{figures['ratio']:.3f}", frames=figures["frames"])
    columns = ("detector", "parameters", "multiply_adds", "ms", "fps", "hands")
    return Sheet(columns, tuple(rows), _series(rows, {"fps": 4}), "detector", (ratio,))


def _table_5(figures: dict[str, Any]) -> Sheet:
    rows: list[tuple[Cell, ...]] = []
    for row in figures["table_5"]:
        paper, paper_depth = PAPER_TABLE_5[row["distance_cm"]]
        ours = [row[camera][mode] for camera in ("monocular", "d435i") for mode in MODES]
        rows.append((row["distance_cm"], paper, *ours[:2], paper_depth, *ours[2:]))
    shown = {"monocular_paper": 1, "monocular_published": 2, "monocular_robust": 3, "d435i_paper": 4, "d435i_robust": 6}
    note = _seeds(FIRST_RULER, figures["hands"])
    return Sheet(("cm", *_BY_CAMERA), tuple(rows), _series(rows, shown), "distance_cm", (note,))


def _table_6(figures: dict[str, Any]) -> Sheet:
    rows: list[tuple[Cell, ...]] = []
    for row in figures["table_6"]:
        cells: list[Cell] = [row["distance_cm"]]
        for number, camera in enumerate(CAMERAS):
            one, cm = row[camera.lower()], row["distance_cm"]
            cells += [PAPER_TABLE_6[cm][number], 100 * one["published"], 100 * one["robust"]]
            cells += [PAPER_FPS[cm][number], one["fps"]]
        rows.append(tuple(cells))
    shown = {"monocular_paper": 1, "monocular_robust": 3, "d435i_paper": 6, "d435i_published": 7, "d435i_robust": 8}
    mono, depth = _BY_CAMERA[:3], _BY_CAMERA[3:]
    columns = ("cm", *mono, "fps_paper", "fps", *depth, "fps_paper", "fps")
    notes = (tr("evaluate.paper.changes", changes=figures["changes"]), _seeds(FIRST_HAND, figures["changes"]))
    return Sheet(columns, tuple(rows), _series(rows, shown), "distance_cm", notes)


def _table_7(figures: dict[str, Any]) -> Sheet:
    rows: list[tuple[Cell, ...]] = []
    for gesture, (success, response_s) in PAPER.items():
        one = figures["per_gesture"][gesture.value]
        ours = (_percent(one["success"]), f"{response_s:.2f}", _seconds(one["response_s"]))
        rows.append((gesture.value, one["trials"], success, *ours))
    overall = (100 * PAPER_OVERALL["paper_success"], _percent(figures["success"]))
    times = (f"{PAPER_OVERALL['paper_response_s']:.2f}", _seconds(figures["response_s"]))
    last = (tr("evaluate.paper.mean"), figures["trials"], *overall, *times)
    series = _series(rows, {"paper": 2, "robust": 3})
    columns = ("gesture", "attempts", "success_paper", "success", "response_paper", "response")
    notes = [
        tr("evaluate.paper.unintended", unintended=figures["unintended"], sessions=figures["sessions"]),
        tr("evaluate.paper.average", **PAPER_OVERALL),
    ]
    programs = tuple(program[:12] for program in figures.get("programs", ()))
    if len(programs) > 1:
        notes.append(tr("evaluate.paper.programs", count=len(programs), programs=programs))
    return Sheet(columns, (*rows, last), series, "gesture", tuple(notes))


Reader = Callable[[dict[str, Any]], Sheet]
READERS: dict[int, Reader] = {3: _table_3, 4: _table_4, 5: _table_5, 6: _table_6, 7: _table_7}


def _series(rows: list[tuple[Cell, ...]], places: dict[str, int]) -> dict[str, Any]:
    return {name: [row[place] for row in rows] for name, place in places.items()}


def _seeds(first: int, hands: int) -> str:
    return tr("evaluate.paper.seeds", first=first, last=first + hands - 1)


def _percent(share: float | None) -> float | None:
    return None if share is None else 100 * share


def _seconds(value: float | None) -> str | None:
    return None if value is None else f"{value:.2f}"


def write_page(out: Path) -> Path:
    """The page, of the tables that were made. Raises AppError when figures can't be read or the page written."""
    require_extra("evaluate", "jinja2", "matplotlib")
    import jinja2
    from markupsafe import Markup

    tables = []
    for number, read in READERS.items():
        if figures_file(out, number).is_file():
            sheet, run = read(read_as(figures_file(out, number), dict[str, Any])), read_as(run_file(out, number), Run)
            drawing = Markup(_plot(sheet, number, out / f"table-{number}.svg"))
            tables.append({"number": number, "sheet": sheet, "run": run, "plot": drawing})
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("app.evaluate.paper", "."), autoescape=True, undefined=jinja2.StrictUndefined
    )
    environment.filters["cell"] = _cell
    page = environment.get_template("page.html.j2").render(
        tables=tables,
        t=lambda key, **values: tr(f"evaluate.{key}", **values),
        language=language(),
        missing=NOT_REPRODUCED,
    )
    path = out / PAGE
    write_whole(path, page.encode())
    return path


def _cell(value: Cell) -> str:
    return "–" if value is None else f"{value:.1f}" if isinstance(value, float) else str(value)


def _plot(sheet: Sheet, number: int, path: Path) -> str:
    """Lines over distances, bars over names; as SVG."""
    labels = [row[0] for row in sheet.rows[: len(next(iter(sheet.series.values())))]]
    with figure(path, size=(9.0, 3.6)) as (_, axes):
        for place, (name, values) in enumerate(sheet.series.items()):
            label = tr(f"evaluate.column.{name}")
            if all(isinstance(one, int) for one in labels):
                axes.plot(labels, [float("nan") if one is None else one for one in values], marker="o", label=label)
            else:
                width = 0.8 / len(sheet.series)
                middle = (len(sheet.series) - 1) / 2
                shifted = [at + (place - middle) * width for at in range(len(labels))]
                axes.bar(shifted, [one or 0.0 for one in values], width, label=label)
                axes.set_xticks(range(len(labels)), labels, rotation=20 if len(labels) < 12 else 0)
        decorate(axes, sheet.axis, f"paper_{number}", f"paper_title_{number}")
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))  # beside the plot, not over its bars
    svg = path.read_text(encoding="utf-8")
    return svg[svg.index("<svg") :]
