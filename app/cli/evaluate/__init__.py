"""rleex evaluate: measures what the documents claim. The evaluations are in `app/evaluate`, loaded when they run."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

import typer

from app.cli.evaluate import detection, gestures, loop, trigger, voice

cli = typer.Typer(no_args_is_help=True)
for subject in (gestures, detection, loop, trigger, voice):
    cli.add_typer(subject.cli)


@cli.callback()
def _begin(context: typer.Context) -> None:
    context.with_resource(_ended_as_by_ctrl_c())


@contextmanager
def _ended_as_by_ctrl_c() -> Iterator[None]:
    """SIGTERM, as of `timeout` or a job scheduler, ends a command as Ctrl-C does: its processes end, work is kept."""

    def end(_number: int, _frame: object) -> NoReturn:
        signal.signal(signal.SIGTERM, lambda *_: None)  # a second one would interrupt the end
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
