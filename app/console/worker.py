"""A process beside the console for one piece of work, which tells how far it is through a pipe."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable


class Worker:
    """Runs from its making to its end; `pipe` gives what it sends, and EOFError once it has ended."""

    def __init__(self, work: Callable[..., None], *arguments: object) -> None:
        """work: importable, for it is spawned; called with its end of the pipe, then the arguments.

        Raises OSError where the computer has no process to give.
        """
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe(duplex=False)
        self._process = context.Process(target=work, args=(theirs, *arguments), daemon=True)
        with theirs:
            self._process.start()

    def end(self) -> None:
        """Whatever it is doing."""
        self._process.kill()
        self._process.join()
        self.pipe.close()
