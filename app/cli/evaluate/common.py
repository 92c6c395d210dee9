"""What the evaluations' commands share: their options, the detector, processes with one each, and progress."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Context

from app.cli.common import bar, check_figure, check_finite, check_output, claim_output, wide_console
from app.evaluate.harness import reading
from app.system.config import load_config
from app.system.hand_model import set_up_model
from app.system.paths import find_home
from app.text.catalogue import render, tr

if TYPE_CHECKING:
    from concurrent.futures import ProcessPoolExecutor

    from kgdfa.keypoints import HandDetector
    from logs.reason import Reason


Plot = Annotated[Path | None, typer.Option("--plot", callback=check_figure, help="Write a plot of it (PNG) here.")]
Workers = Annotated[int, typer.Option(help="Processes that detect hands at the same time.", min=1, max=64)]
Focal = Annotated[
    float,
    typer.Option(callback=check_finite, help="Focal length of the digital camera, px at 1280×720.", min=200, max=3000),
]
Seeds = Annotated[str, typer.Option(help="Digital hands: seeds and ranges of seeds, separated by commas.")]
Click = Annotated[str, typer.Option(help="Seconds to press and withdraw: 0.3, or a range, 0.3-0.8.")]


def check_keypoints(context: Context, path: Path | None) -> Path | None:
    """An option's callback: a file that is there is only read. Raises AppError before the work begins."""
    if path is not None:
        with reading(path):
            if path.is_file():
                path.open("rb").close()
                return claim_output(context, path)
    return check_output(context, path)


Keypoints = Annotated[
    Path | None,
    typer.Option(
        callback=check_keypoints,
        help="Keep the keypoints in this npz, and detect only photos that it lacks or that differ now.",
    ),
]
Directory = Annotated[Path | None, typer.Argument(help="Folder with labels.csv and images.")]


def hand_model(home: Path | None) -> Path:
    """Where the hand model is, fetched first if it must be. Raises AppError when it can't be had."""
    place = find_home(home)
    return set_up_model(place, load_config(place.config))


def open_detector(home: Path | None) -> HandDetector:
    """As before a camera; the library behind it takes a second to import."""
    from kgdfa.keypoints import live_detector

    return live_detector(hand_model(home))


@contextmanager
def detector_processes(
    home: Path | None, workers: int, total: int
) -> Iterator[tuple[ProcessPoolExecutor, Callable[[], None]]]:
    """Processes with a detector each, and a bar for the pieces of work."""
    from app.evaluate.detector_pool import detector_pool

    with detector_pool(hand_model(home), workers) as pool, progress("simulating", total) as step:
        yield pool, step


def progress(what: str, total: int, **values: object) -> AbstractContextManager[Callable[..., None]]:
    return bar(wide_console(), tr(f"evaluate.progress.{what}", **values), total)


@contextmanager
def status_line() -> Iterator[Callable[[str], None]]:
    """A spinner, on a terminal; the yielded function sets the text beside it."""
    console = wide_console()
    if not console.is_interactive:
        yield lambda _: None
        return
    with console.status(tr("evaluate.progress.fitting")) as status:
        yield status.update


def unreadable_lines(unreadable: Mapping[str, Reason], key: str = "unreadable", rows: int | None = None) -> list[str]:
    """The images that can't be used, by their paths, and why. key: of the line above them, below `evaluate.`.

    rows: which that line counts, where a table lists an image more than once.
    """
    lines = [f"  {path}: {render(why)}" for path, why in unreadable.items()]
    return [tr(f"evaluate.{key}", count=rows or len(lines)), *lines] if lines else []
