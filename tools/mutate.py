"""Runs the mutants of one module that cosmic-ray has listed, each in a fork of a process that has loaded the libraries.

The order is random but always the same, so that a run that is cut short has judged a fair sample. Run from the copy of
the tree that `tools/mutation` makes: `python tools/mutate.py SESSION MODULE TESTS [AT_MOST]`.
"""

from __future__ import annotations

import importlib.abc
import os
import random
import signal
import sys
from difflib import unified_diff
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from pathlib import Path
from types import CodeType

import cosmic_ray.plugins
import hypothesis  # noqa: F401 - what the tests load is loaded once
import numpy as np  # noqa: F401
import pytest
from cosmic_ray.mutating import mutate_code
from cosmic_ray.work_db import WorkDB, use_db
from rich.progress import track

TIMEOUT_S = 120
SEED = 1
OPTIONS = ("-q", "-x", "-p", "no:cacheprovider", "-W", "ignore:Module already imported")


class Mutant(SourceFileLoader):
    """Loads a changed source in a file's place."""

    def __init__(self, name: str, path: str, source: str) -> None:
        super().__init__(name, path)
        self._source = source

    def get_code(self, fullname: str) -> CodeType:  # noqa: ARG002 - the loader's
        """The changed source, compiled."""
        code: CodeType = compile(self._source, self.path, "exec", dont_inherit=True)
        return code


class Finder(importlib.abc.MetaPathFinder):
    """Finds one module changed and leaves the others alone."""

    def __init__(self, module: str, file: Path, source: str) -> None:
        self._module, self._file, self._source = module, str(file), source

    def find_spec(self, fullname: str, path: object = None, target: object = None) -> ModuleSpec | None:  # noqa: ARG002
        """The changed module's spec, or None."""
        if fullname != self._module:
            return None
        return spec_from_file_location(fullname, self._file, loader=Mutant(fullname, self._file, self._source))


def survives(module: str, file: Path, source: str, tests: list[str]) -> bool:
    """Whether all tests pass on this source."""
    child = os.fork()
    if child == 0:
        signal.alarm(TIMEOUT_S)
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 1)
        os.dup2(null, 2)
        sys.meta_path.insert(0, Finder(module, file, source))
        os._exit(int(pytest.main([*OPTIONS, *tests])))
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def mutants(session: str, source: str) -> list[str]:
    """The changed sources, in their order."""
    with use_db(session, WorkDB.Mode.open) as database:
        left_out = {job for job, _ in database.results}
        items = [item.mutations[0] for item in database.work_items if item.job_id not in left_out]
    random.Random(SEED).shuffle(items)
    changed = [
        mutate_code(source, cosmic_ray.plugins.get_operator(i.operator_name)(**i.operator_args), i.occurrence)
        for i in items
    ]
    return [code for code in changed if code is not None]


def main(session: str, module: str, tests: str, at_most: str = "1000000") -> None:
    """Judge them, print the survivors and the score."""
    sys.path.insert(0, str(Path.cwd()))
    file = Path(module.replace(".", "/") + ".py")
    source = file.read_text(encoding="utf-8")
    if not survives(module, file, source, tests.split()):
        raise SystemExit("The tests do not pass without any change.")
    every = mutants(session, source)
    judged = every[: int(at_most)]
    alive = [code for code in track(judged, description=module) if survives(module, file, code, tests.split())]
    for code in alive:
        print(*list(unified_diff(source.splitlines(), code.splitlines(), lineterm="", n=0))[2:], sep="\n")
    print(f"{module}: {len(judged) - len(alive)} of {len(judged)} noticed; {len(every)} changes in all")


if __name__ == "__main__":
    main(*sys.argv[1:])
