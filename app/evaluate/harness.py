"""What every evaluation shares: its faults, tables for the terminal, JSON and figures, and the check for the extra."""

from __future__ import annotations

import io
import math
import multiprocessing
import os
import re
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from enum import Enum, auto
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
from rich.table import Table
from rich.text import Text

from app.ipc.streams import TRIGGER
from app.system import files
from app.system.errors import AppError
from app.text.catalogue import language, tr, use_language
from logs.disk import append_line
from logs.reading.errors import cause_of
from logs.reading.formats import MAX_JSON_LINES, decode_json_lines
from logs.reading.regular import read_bytes
from logs.reason import sanitize_terminal

FRAME_NS = TRIGGER.period_ns  # 30 frames per second: the camera's rate, where a recording names none
MOST_SEEDS = 1000  # in one range
DISTANCES_CM = tuple(range(10, 75, 5))  # of the paper's Tables 5 and 6
MODES = ("published", "robust")
CLICK_RANGE_S = (0.2, 3.0)  # to press and withdraw
Kept = TypeVar("Kept")
Step = Callable[[], None]  # called after each piece of work, for a progress bar


class EvaluateFault(Enum):
    """What an evaluation refuses, and why an image could not be used."""

    EXTRA_MISSING = auto()  # extra
    FILE_UNREADABLE = auto()  # file, detail
    FILE_UNWRITABLE = auto()  # file, detail
    TABLE_COLUMNS = auto()  # file, columns
    TABLE_EMPTY = auto()  # file
    ROW_FIELDS = auto()  # file, line, found, due
    ROW_NUMBER = auto()  # file, line, detail
    ROW_DISTANCE = auto()  # file, line, distance_cm
    ROW_LABEL = auto()  # file, line, label
    ROW_PATH = auto()  # file, line
    ROW_STOP = auto()  # file, line, stop
    VIDEO_ROW = auto()  # file, line
    VIDEO_START = auto()  # file
    VIDEO_ORDER = auto()  # file, line, frames
    VIDEO_UNREADABLE = auto()  # file
    LABELS_OPTION = auto()  # file
    IMAGE_UNREADABLE = auto()  # file
    KEYPOINTS_UNREADABLE = auto()  # file, detail
    KEYPOINTS_OF_OTHERS = auto()  # file
    FOLDER_OR_DIGITAL = auto()
    WITH_ALONE = auto()
    SEEDS = auto()  # seeds
    CLICK = auto()  # click, low_s, high_s
    WORKER_TIMEOUT = auto()  # limit_s
    WORKER_ENDED = auto()
    NORM_UNREADABLE = auto()  # file, detail
    ACTION_UNKNOWN = auto()  # name, names
    NO_ROUND = auto()  # seed, sessions, reason, session
    NO_HAND = auto()
    PROGRESS_OF_OTHERS = auto()  # file
    ONNX_UNREADABLE = auto()  # file, detail
    ONNX_OUTPUTS = auto()  # file, outputs
    ONNX_NOT_RUN = auto()  # file, detail
    NO_SPEECH = auto()  # program
    TABLE_NOT_MADE = auto()  # table, command, status
    WALK_REFUSED = auto()  # why


def require_extra(extra: str, *modules: str) -> None:
    """Raises AppError unless the modules that an extra brings are installed."""
    if any(find_spec(name) is None for name in modules):
        raise AppError(EvaluateFault.EXTRA_MISSING, extra=extra)


def seed_numbers(seeds: str) -> list[int]:
    """Numbers and ranges of numbers, such as `1,2` or `5000-5009`. Raises AppError."""
    parts = [re.fullmatch(r"(\d{1,9})(?:-(\d{1,9}))?", part.strip(), re.ASCII) for part in seeds.split(",")]
    ranges = [range(int(part[1]), int(part[2] or part[1]) + 1) for part in parts if part]
    if len(ranges) < len(parts) or not all(0 < len(one) <= MOST_SEEDS for one in ranges):
        raise AppError(EvaluateFault.SEEDS, seeds=seeds)
    return list(dict.fromkeys(number for one in ranges for number in one))


def click_range(click: str) -> tuple[float, float]:
    """`0.3`, or a range such as `0.3-0.8`, seconds. Raises AppError."""
    parts = re.fullmatch(r"(\d+(?:\.\d+)?)(?:-(\d+(?:\.\d+)?))?", click.strip(), re.ASCII)
    low_s, high_s = (float(parts[1]), float(parts[2] or parts[1])) if parts else (0.0, 0.0)
    if not CLICK_RANGE_S[0] <= low_s <= high_s <= CLICK_RANGE_S[1]:
        raise AppError(EvaluateFault.CLICK, click=click, low_s=CLICK_RANGE_S[0], high_s=CLICK_RANGE_S[1])
    return low_s, high_s


def table(
    title: str,
    columns: str,
    rows: Iterable[Sequence[object]] = (),
    *,
    left: int = 1,
    caption: str = "",
    **values: object,
) -> Table:
    """A table for the terminal. title, caption and columns (in one string) are keys below `evaluate.`.

    The first `left` columns stand to the left, figures to the right.
    """
    made = Table(
        title=plain(tr(f"evaluate.{title}", **values), "table.title"),
        caption=plain(tr(f"evaluate.{caption}", **values), "table.caption") if caption else None,
    )
    for number, column in enumerate(columns.split()):
        heading = "" if column == "empty" else tr(f"evaluate.column.{column}")
        made.add_column(plain(heading), justify="left" if number < left else "right")
    for row in rows:
        made.add_row(*map(plain, row))
    return made


def plain(content: object, style: str = "") -> Text:
    """Shown as it is: paths and what a CSV names may hold brackets, which a table takes for markup."""
    return Text(sanitize_terminal(str(content)), style)


def decimals(value: float | None, form: str) -> str:
    """A figure in this format; a dash where nothing was measured."""
    return "–" if value is None or math.isnan(value) else format(value, form)


def percent(share: float | None, digits: int = 1) -> str:
    """A share as per cent; a dash for one of nothing."""
    return decimals(share, f".{digits}%")


def mean(values: Iterable[float]) -> float | None:
    """The mean; None of nothing."""
    listed = [float(value) for value in values]
    return float(np.mean(listed)) if listed else None


def write_json(content: Mapping[str, Any] | Sequence[Any], path: Path | None) -> None:
    """Write the figures, where a file was named. Raises AppError when it can't be written."""
    if path is not None:
        write_whole(path, msgspec.json.format(msgspec.json.encode(content), indent=1) + b"\n")


def write_whole(path: Path, content: bytes) -> None:
    """Write the whole file or none: an older one stays where the disk refuses. Raises AppError."""
    with writing(path):
        files.write_whole(path, content)


def kept_lines(path: Path | None, kind: type[Kept]) -> tuple[Kept, ...]:
    """What an earlier run kept there, a line each. Raises AppError for a file that can't be used.

    After whole lines, a last one that was cut off is taken out of the file: what is kept next begins a line.
    """
    if path is None or not path.exists():
        return ()
    with reading(path):
        data = read_bytes(path, MAX_JSON_LINES)
        whole_bytes = data.rfind(b"\n") + 1 or len(data)  # a file without any whole line may be another's: it stays
        kept = decode_json_lines(data[:whole_bytes], kind)
        if whole_bytes < len(data):
            os.truncate(path, whole_bytes)
    return kept


def keep_line(content: Any, path: Path | None) -> None:
    """Add a line, where a file was named. Raises AppError when it can't be written."""
    if path is not None:
        with writing(path):
            append_line(path, msgspec.json.encode(content) + b"\n")


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """The same while reading what an earlier run kept."""
    try:
        yield
    except OSError as error:
        raise AppError(EvaluateFault.FILE_UNREADABLE, file=path, detail=cause_of(error)) from error


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Any error of the system while writing is an AppError that names the file."""
    try:
        yield
    except (OSError, ValueError) as error:
        raise AppError(EvaluateFault.FILE_UNWRITABLE, file=path, detail=cause_of(error)) from error


@contextmanager
def process_pool(
    count: int, initializer: Callable[..., object], initargs: tuple[object, ...] = ()
) -> Iterator[ProcessPoolExecutor]:
    """Processes, spawned, that end with this one; on leaving early, work not begun is dropped.

    initializer: what each begins with. Raises AppError when one of them ends.
    """
    begin = partial(_begin, initializer, *initargs)
    pool = ProcessPoolExecutor(count, mp_context=multiprocessing.get_context("spawn"), initializer=begin)
    try:
        yield pool
    except BrokenProcessPool as error:
        raise AppError(EvaluateFault.WORKER_ENDED) from error
    finally:
        pool.shutdown(cancel_futures=True)


def _begin(initializer: Callable[..., object], *initargs: object) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the pool by its parent, after the work under way
    threading.Thread(target=_end_with_parent, daemon=True).start()
    initializer(*initargs)


def _end_with_parent() -> None:
    """A parent that was killed ends no pool: its processes would wait for work for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def in_english() -> Iterator[None]:
    """Text within is English: the fonts that draw on images and figures have no Chinese."""
    before = language()
    use_language("en")
    try:
        yield
    finally:
        use_language(before)


@contextmanager
def figure(
    path: Path, rows: int = 1, columns: int = 1, *, size: tuple[float, float] = (9.0, 4.8), share_y: bool = False
) -> Iterator[tuple[Any, Any]]:
    """A matplotlib figure and its axes, in English, written as PNG at the end.

    Raises AppError without matplotlib, or when it can't be written.
    """
    require_extra("evaluate", "matplotlib")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    made = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(made)
    with in_english():
        yield made, made.subplots(rows, columns, sharey=share_y)
    drawn = io.BytesIO()
    with writing(path):
        made.savefig(drawn, dpi=110, format=path.suffix[1:] or "png")
    write_whole(path, drawn.getvalue())


def decorate(axes: Any, x: str, y: str, title: str, **values: object) -> None:
    """Axis labels and title by their keys below `evaluate.plot.`, a grid and a legend."""
    axes.set(
        xlabel=tr(f"evaluate.plot.{x}"), ylabel=tr(f"evaluate.plot.{y}"), title=tr(f"evaluate.plot.{title}", **values)
    )
    axes.grid(alpha=0.3)
    if axes.get_legend_handles_labels()[0]:  # matplotlib warns where nothing was drawn
        axes.legend()
