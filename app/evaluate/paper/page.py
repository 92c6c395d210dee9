"""The page of the paper's tables: one HTML file that fetches nothing, each table with its plot and its command."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from app.evaluate.harness import decorate, figure, require_extra, write_whole
from app.evaluate.paper.make import Run, figures_file, read_as, run_file
from app.evaluate.paper.sheets import READERS, Cell, Sheet
from app.text.catalogue import language, tr

NOT_REPRODUCED = ("training", "detectors", "lite", "link", "people")  # why: in the catalogue
PAGE = "paper.html"


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
