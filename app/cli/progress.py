"""Progress for work that takes longer than a breath."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn


def wide_console() -> Console:
    """The terminal as it is; a pipe or a file gets lines wide enough for a table."""
    return Console() if Console().is_terminal else Console(width=160)


@contextmanager
def spinner(console: Console, total: int) -> Iterator[Callable[[str], None]]:
    """A bar that advances with every message given to the yielded function (the first opens it)."""
    columns = (BarColumn(), TextColumn("{task.completed:.0f}/{task.total:.0f} {task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("", total=total)
        reports = -1

        def watch(what: str) -> None:
            nonlocal reports
            reports += 1
            progress.update(task, description=what, completed=max(reports - 1, 0))

        yield watch


@contextmanager
def bar(console: Console, what: str, total: int) -> Iterator[Callable[..., None]]:
    """A bar for `total` things of a kind; the yielded function advances it by one, or by the number given."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f}/{task.total:.0f}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(what, total=total)
        yield lambda count=1: progress.advance(task, count)
