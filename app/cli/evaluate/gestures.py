"""rleex evaluate gestures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.evaluate.looking import looked_at, looked_at_digital, looked_at_digital_to_fit
from app.cli.evaluate.options import Home, Json

if TYPE_CHECKING:
    from rich.console import Console

    from app.evaluate.gesture_measures import Judged
    from app.evaluate.gesture_photos import SeenPhoto

cli = typer.Typer()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Outputs:
    """Where the figures go besides the screen; the misjudged photos are read from `directory` again."""

    directory: Path | None
    json_file: Path | None
    png: Path | None
    errors: Path | None


@cli.command()
def gestures(
    directory: Annotated[Path | None, typer.Argument(help="Folder with labels.csv and pictures.")] = None,
    json_file: Json = None,
    errors: Annotated[Path | None, typer.Option(help="Write the misjudged pictures here, drawn upon.")] = None,
    png: Annotated[Path | None, typer.Option(help="Write the confusion matrices here as a PNG.")] = None,
    cross_validate: Annotated[
        bool, typer.Option("--cross-validate", help="Fit anew for each source of photos left out.")
    ] = False,
    seed: Annotated[int, typer.Option(help="With --cross-validate: which examples and noise are drawn.", min=0)] = 0,
    keypoints: Annotated[
        Path | None, typer.Option(help="Keep the keypoints in this npz, and use it when it is there.")
    ] = None,
    digital: Annotated[
        int, typer.Option(help="Measure on this many digital hands a pose instead of a folder.", min=0)
    ] = 0,
    single_look: Annotated[bool, typer.Option("--single-look", help="Judge one look, as in video.")] = False,
    prepare: Annotated[str, typer.Option(help="Preprocessing: none, denoise, sharpen or denoise+sharpen.")] = "none",
    home: Home = None,
) -> None:
    """Table 3: how well both rule sets recognise gestures, and refuse what is none."""
    from rich.console import Console

    from app.evaluate.gestures import CROSS_VALIDATED, SHIPPED, judge_as_shipped
    from kgdfa.preprocess import find_preparation

    step, console, looks = find_preparation(prepare), Console(), 1 if single_look else None
    if digital and directory is None:
        seen = looked_at_digital(console, digital, home, step)
    else:
        seen = looked_at(console, _only(directory, digital), keypoints, home, step)
    if cross_validate:
        judged = _cross_validated(console, seen, looked_at_digital_to_fit(console, keypoints, home), looks, seed)
    else:
        judged = judge_as_shipped(seen, looks=looks)
    how = CROSS_VALIDATED if cross_validate else SHIPPED
    how += f"; {'one look' if single_look or digital else 'up to six looks'} a picture"
    _tell(console, judged, seen, how, _Outputs(json_file=json_file, png=png, errors=errors, directory=directory))


def _only(directory: Path | None, digital: int) -> Path:
    """The folder, when nothing else was asked for."""
    from app.system.errors import AppError

    if directory is None or digital:
        raise AppError("Give a folder with labels.csv, or --digital N, and not both.")
    return directory


def _cross_validated(
    console: Console, seen: list[SeenPhoto], digital: list[SeenPhoto], looks: int | None, seed: int
) -> dict[str, list[Judged]]:
    from app.evaluate.gestures import judge_cross_validated

    with console.status("fitting") as status:
        return judge_cross_validated(seen, digital, status.update, looks=looks, seed=seed)


def _tell(
    console: Console, judged: dict[str, list[Judged]], seen: list[SeenPhoto], how: str, outputs: _Outputs
) -> None:
    """Everything measured, on the screen and into the files asked for."""
    from app.evaluate import gesture_report as report
    from app.evaluate.gestures import measure_all

    figures = measure_all(judged)
    for name, one in figures.items():
        report.print_figures(console, name, one, len(seen))
        report.print_confusion(console, name, one)
    console.print(f"robust: {how}")
    _list_unreadable(console, seen)
    if outputs.json_file is not None:
        report.write_json(report.as_json(figures, seen, how), outputs.json_file)
    if outputs.png is not None:
        report.write_confusion(figures, outputs.png)
    if outputs.errors is not None and outputs.directory is not None:
        count = report.write_errors(judged["robust"], seen, outputs.directory, outputs.errors)
        console.print(f"{count} misjudged pictures, drawn upon where they can be read, in {outputs.errors}")


def _list_unreadable(console: Console, seen: list[SeenPhoto]) -> None:
    unreadable = [one for one in seen if one.error]
    if unreadable:
        console.print(f"{len(unreadable)} pictures could not be read and count as misjudged:")
        for one in unreadable:
            console.print(f"  {one.photo.path}: {one.error}")
