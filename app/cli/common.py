"""What the commands share: options, refusals, text in the language in use, and progress. Rich waits inside."""

from __future__ import annotations

import errno
import itertools
import math
import os
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from enum import Enum, auto
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import CallbackParam, Context

from app.system.errors import AppError
from app.system.files import is_there
from app.text.catalogue import tr
from logs.reading.errors import InputError, InputFault, cause_of
from logs.reason import sanitize_terminal

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table


def home_of(text: str) -> Path:
    """An option's parser: refuse a home that is empty or no folder before the work begins. Raises AppError.

    As a path, an empty text is the current folder.
    """
    if not text:
        raise AppError(CliFault.HOME_EMPTY)
    from app.system.paths import find_home

    find_home(Path(text))
    return Path(text)


HomeOption = Annotated[
    Path | None,
    typer.Option(
        "--home",
        parser=home_of,
        metavar="<path>",
        help="Data directory; default: RLEEX_HOME, else what `rleex locate` prints.",
    ),
]


class CliFault(Enum):
    """What a command refuses by itself."""

    NO_SUCH_ROLE = auto()  # role
    NO_OPERATORS = auto()
    NO_SUCH_PERMISSION = auto()  # permission, known
    TOKEN_FOR_WHAT = auto()  # role, known
    NO_QUESTION = auto()  # ready
    QUESTION_OF_SITES = auto()  # question
    NOT_KEPT = auto()  # doubt
    OUTPUT_UNWRITABLE = auto()  # path, detail
    OUTPUT_IS_EVIDENCE = auto()  # path
    OUTPUT_TWICE = auto()  # path
    FIGURE_FORMAT = auto()  # path, known
    NOT_FINITE = auto()  # option, value
    NO_MOMENT = auto()  # option, value
    OPTION_UNUSED = auto()  # option, command
    PREFLIGHT_ELSEWHERE = auto()  # host
    HOME_EMPTY = auto()
    NO_FOLDER = auto()  # path
    NO_TERMINAL = auto()
    SYSTEM = auto()  # detail


def print_text(key: str, **values: object) -> None:
    """Print a text of the catalogues."""
    typer.echo(tr(key, **values))


def sql_of(sql: str, ask: str, questions: Mapping[str, str]) -> str:
    """The SQL that is given, or that of a ready question. Raises AppError unless it is one of them."""
    if bool(sql) == bool(ask) or (ask and ask not in questions):
        ready = "; ".join(f"{name}: {tr(f'question.{name}')}" for name in questions)
        raise AppError(CliFault.NO_QUESTION, ready=ready)
    return sql or questions[ask]


def print_answer(answer: Any, *, json: bool) -> None:
    """An answer's rows, a line each as JSON, or as a table."""
    from rich.console import Console

    from app.text.recorded import render_recorded
    from logs.query import as_json, as_table

    if json:
        for line in as_json(answer):
            typer.echo(line)
    else:
        Console(highlight=False, markup=False).print(as_table(answer, render_recorded))


EVIDENCE_SUFFIXES = (".jsonl", ".mcap", ".can.log")  # trails and journals, recordings, records of a bus


def check_output(context: Context, path: Path | None) -> Path | None:
    """An option's callback: refuse a file that can't be written before the work begins. Raises AppError.

    So is one that is there and is evidence (`--json` takes a file in `audit verify`, none in `audit show`), and one
    that two options name.
    """
    return None if path is None else check_replaced(claim_output(context, path))


def check_appended(context: Context, path: Path | None) -> Path | None:
    """The same for a file that lines are added to: where it is there, its folder need take no new one."""
    return None if path is None else _check_file(claim_output(context, path), replaced=False)


def check_bus_log(context: Context, path: Path | None) -> Path | None:
    """The same for a bus log. A session's own, beside a trail of its name, is evidence and not appended to."""
    if check_appended(context, path) is not None and path is not None and path.exists():
        place = Path(os.path.realpath(path))
        trail = place.with_name(place.name.removesuffix(EVIDENCE_SUFFIXES[-1]) + EVIDENCE_SUFFIXES[0])
        if place.name.endswith(EVIDENCE_SUFFIXES[:-1]) or _beside_keys(place) or trail.exists():
            raise AppError(CliFault.OUTPUT_IS_EVIDENCE, path=path)
    return path


def claim_output(context: Context, path: Path) -> Path:
    """The file, for this option alone. Raises AppError when another one of the command names it too."""
    claimed: set[str] = context.meta.setdefault(__name__, set())
    with _tried(path):
        place = os.path.realpath(path)
    if place in claimed:
        raise AppError(CliFault.OUTPUT_TWICE, path=path)
    claimed.add(place)
    return path


def check_replaced(path: Path) -> Path:
    """The file, if it can be made or replaced by a whole one. Raises AppError.

    Nothing stays: the folder is tried with a nameless file.
    """
    return _check_file(path, replaced=True)


def _check_file(path: Path, *, replaced: bool) -> Path:
    with _tried(path):
        if is_there(path):
            if not path.is_file():
                raise InputError(InputFault.NOT_REGULAR)
            path.open("r+b").close()
            if not replaced:
                return path
            if _is_evidence(Path(os.path.realpath(path))):
                raise AppError(CliFault.OUTPUT_IS_EVIDENCE, path=path)
        with tempfile.TemporaryFile(dir=Path(os.path.realpath(path)).parent):
            return path


def _is_evidence(path: Path) -> bool:
    return path.name.endswith(EVIDENCE_SUFFIXES) or _beside_keys(path)


def _beside_keys(path: Path) -> bool:
    """In a folder with a console's keys, its operators and anchors."""
    from logs.keys import KEY_FILE

    return any((folder / KEY_FILE).exists() for folder in path.parents)


@contextmanager
def _tried(path: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError) as error:
        raise AppError(CliFault.OUTPUT_UNWRITABLE, path=path, detail=cause_of(error)) from error


def check_figure(context: Context, path: Path | None) -> Path | None:
    """The same for a figure, whose name's ending is its format."""
    if check_output(context, path) is not None and path is not None and path.suffix:
        from matplotlib.backend_bases import FigureCanvasBase

        known = FigureCanvasBase.get_supported_filetypes().keys() - {"pgf"}  # that needs LaTeX, and fails at the end
        if path.suffix[1:].lower() not in known:
            raise AppError(CliFault.FIGURE_FORMAT, path=path, known=", ".join(sorted(known)))
    return path


def check_input_folder(path: Path | None) -> Path | None:
    """An option's callback: refuse a folder that is not there before the work begins. Raises AppError."""
    if path is not None and not path.is_dir():
        raise AppError(CliFault.NO_FOLDER, path=path)
    return path


def check_output_folder(path: Path | None) -> Path | None:
    """The same for a folder that the command makes, with those above it."""
    if path is None:
        return None
    try:
        first = next(one for one in (path, *path.absolute().parents) if is_there(one))
        if not first.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
        with tempfile.TemporaryFile(dir=first):
            return path
    except OSError as error:
        raise AppError(CliFault.OUTPUT_UNWRITABLE, path=path, detail=cause_of(error)) from error


def check_terminal() -> None:
    """Refuse a console that nobody could see or type at; a browser's has a driver of its own. Raises AppError.

    Without one Textual draws into a file, and its input thread reads an end of file again and again.
    """
    if not (os.environ.get("TEXTUAL_DRIVER") or (os.isatty(0) and os.isatty(2))):  # it draws on stderr
        raise AppError(CliFault.NO_TERMINAL)


MAX_SEED = 2**32 - 1
PORT = 7447  # app.link.wire.PORT, without its imports


def refuse_options(command: str, options: Mapping[str, object]) -> None:
    """Refuse options that are given and would do nothing. Raises AppError."""
    for option, value in options.items():
        if value:
            raise AppError(CliFault.OPTION_UNUSED, option=option, command=command)


def check_finite(parameter: CallbackParam, value: float | None) -> float | None:
    """An option's callback: refuse inf and nan, which pass every range. Raises AppError."""
    if value is not None and not math.isfinite(value):
        raise AppError(CliFault.NOT_FINITE, option=parameter.opts[0], value=value)
    return value


Json = Annotated[Path | None, typer.Option("--json", callback=check_output, help="Write the figures here as well.")]


def wide_console() -> Console:
    """The terminal as it is; a pipe or a file gets lines wide enough for a table."""
    from rich.console import Console

    return Console() if Console().is_terminal else Console(width=160)


@contextmanager
def shown_after(parts: Iterable[Table | str] | Callable[[], None]) -> Iterator[None]:
    """Write within, then show, or call what shows: a closed stdout costs no file, a full disk none of what is shown.

    Who closes the pipe has had enough; the exit status stays the command's own.
    """
    try:
        yield
    finally:
        try:
            if callable(parts):
                parts()
            else:
                show(*parts)
        except (BrokenPipeError, SystemExit):  # Rich makes one of the other, with status 1
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is buffered fails no more at the end


def show(*parts: Table | str) -> None:
    """Tables and texts, neither markup nor escapes in them."""
    console = wide_console()
    for part in parts:
        console.print(sanitize_terminal(part) if isinstance(part, str) else part, markup=False, emoji=False)


@contextmanager
def spinner(console: Console, total: int) -> Iterator[Callable[[str], None]]:
    """A bar that advances with every message given to the yielded function (the first opens it), on a terminal."""
    if not console.is_interactive:  # Rich would end it with a line, which a stdout that is full or closed refuses
        yield lambda _: None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (BarColumn(), TextColumn("{task.completed:.0f}/{task.total:.0f} {task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("", total=total)
        messages = itertools.count(-1)
        yield lambda what: progress.update(task, description=what, completed=max(next(messages), 0))


@contextmanager
def bar(console: Console, what: str, total: int) -> Iterator[Callable[..., None]]:
    """A bar for `total` things of a kind, on a terminal; the yielded function advances it by one, or by so many."""
    if not console.is_interactive:
        yield lambda *_: None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    counted = TextColumn("{task.completed:.0f}/{task.total:.0f}")
    columns = (TextColumn("{task.description}"), BarColumn(), counted, TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(what, total=total)
        yield lambda count=1: progress.advance(task, count)
