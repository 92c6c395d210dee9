"""Runs the mutants of one module that cosmic-ray has listed, each in a fork of a process that has loaded the libraries.

The order is random but always the same, so that a run that is cut short has tested a fair sample. Survivors are printed
as they are found and the score as it goes; an interrupted run ends with its score. Tests that have detected a mutant
before run first, then the quick ones, and the first failure ends a mutant. Run from the copy of the tree that
`tools/mutation` makes: `python tools/mutate.py SESSION MODULE TESTS [FIRST [AT_MOST]]`; FIRST continues where an
earlier run of the same source was cut short.
"""

from __future__ import annotations

import ast
import gc
import importlib.abc
import os
import random
import signal
import sys
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from difflib import unified_diff
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from pathlib import Path
from types import CodeType

import cosmic_ray.plugins
import pytest
from cosmic_ray.mutating import mutate_code
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import MutationSpec
from rich.console import Console
from rich.progress import track

CPU_S = 20  # of one test; the longest takes a tenth of it, and a mutant that computes for longer never ends
WALL_S = 3600  # one that waits instead of computing; at idle priority on a busy host a test waits long for its turn
REPORT_EVERY = 20  # mutants; without a terminal for a progress bar
SEED = 1
OPTIONS = ("-q", "-x", "--assert=plain", "-p", "no:cacheprovider", "-W", "ignore", "-o", "filterwarnings=")
# The same for None and members of an Enum, and nothing else is asked so in these modules.
SAME = {"core/ReplaceComparisonOperator_Is_Eq", "core/ReplaceComparisonOperator_IsNot_NotEq"}
OURS = ("app", "hal", "kgdfa", "logs", "profiles", "testing", "tests")


class Mutant(SourceFileLoader):
    """Loads a mutated source in place of a file."""

    def __init__(self, name: str, path: str, source: str) -> None:
        super().__init__(name, path)
        self._source = source

    def get_code(self, fullname: str) -> CodeType:  # noqa: ARG002 - the loader's
        """The mutated source, compiled."""
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


@dataclass
class Order:
    """A pytest plugin: runs the tests in the order that notices a change soonest, and learns it."""

    durations_s: dict[str, float] = field(default_factory=dict)
    noticed: Counter[str] = field(default_factory=Counter)

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Those that have noticed most changes first, then the quickest case of each test, then its further cases."""
        items.sort(key=self._duration_s)
        siblings: Counter[str] = Counter()
        place = {}
        for item in items:
            test = item.nodeid.partition("[")[0]
            place[item.nodeid] = siblings[test]
            siblings[test] += 1
        items.sort(key=lambda item: (-self.noticed[item.nodeid], place[item.nodeid]))

    def _duration_s(self, item: pytest.Item) -> float:
        return self.durations_s.get(item.nodeid, 0.0)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """How long a test took."""
        self.durations_s[report.nodeid] = self.durations_s.get(report.nodeid, 0.0) + report.duration


@dataclass
class Verdict:
    """A pytest plugin: ends a child at the first failure, or when all is done, without pytest's tidying up."""

    pipe: int

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_setup(self) -> None:
        """Every test has its time; nothing in Python has to be awake when it is over."""
        signal.setitimer(signal.ITIMER_PROF, CPU_S)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_makereport(self, item: pytest.Item, call: pytest.CallInfo[None]) -> None:
        """Tells who noticed."""
        if call.excinfo is not None and not call.excinfo.errisinstance(pytest.skip.Exception):
            os.write(self.pipe, item.nodeid.encode())
            os._exit(1)

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionfinish(self, exitstatus: int) -> None:
        """Nobody noticed, or nothing could be collected."""
        os._exit(int(exitstatus))


@dataclass
class Jury:
    """The tests of one module, in a process that has loaded every library but none of the project's modules."""

    module: str
    file: Path
    tests: list[str]
    order: Order = field(default_factory=Order)
    endless: int = 0  # mutants that were ended, not answered

    def prepare(self) -> None:
        """Run the tests once on the unchanged module. Raises SystemExit when they fail."""
        if pytest.main([*OPTIONS, *self.tests], plugins=[self.order]):
            raise SystemExit("The tests do not pass without any change.")
        for name in [name for name in sys.modules if name.split(".")[0] in OURS]:
            del sys.modules[name]
        gc.collect()
        gc.freeze()

    def passes(self, source: str) -> bool:
        """Whether all tests pass on this source."""
        receiving, sending = os.pipe()
        child = os.fork()
        if child == 0:
            self._judge(source, sending)
        os.close(sending)
        with os.fdopen(receiving) as pipe:
            noticed_by = pipe.read()
        if noticed_by:
            self.order.noticed[noticed_by] += 1
        ended = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        self.endless += ended in {-signal.SIGALRM, -signal.SIGPROF}
        return ended == 0

    def _judge(self, source: str, sending: int) -> None:
        """In the child, which ends here."""
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.alarm(WALL_S)
        signal.setitimer(signal.ITIMER_PROF, CPU_S)
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 1)
        os.dup2(null, 2)
        sys.meta_path.insert(0, Finder(self.module, self.file, source))
        os._exit(int(pytest.main([*OPTIONS, *self.tests], plugins=[self.order, Verdict(sending)])))


Position = tuple[int, int]  # line from 1, column from 0


def annotated(source: str) -> list[tuple[Position, Position]]:
    """Where annotations begin and end; `from __future__ import annotations` never evaluates them."""
    nodes = (
        found
        for node in ast.walk(ast.parse(source))
        for found in (getattr(node, "annotation", None), getattr(node, "returns", None))
        if isinstance(found, ast.expr)
    )
    return [((one.lineno, one.col_offset), (one.end_lineno or 0, one.end_col_offset or 0)) for one in nodes]


def observable(changes: list[MutationSpec], source: str) -> list[MutationSpec]:
    """Without those that nothing can notice, whatever the tests."""
    unread = annotated(source)
    return [
        change
        for change in changes
        if change.operator_name not in SAME
        and not any(begin <= change.start_pos and change.end_pos <= end for begin, end in unread)
    ]


def mutants(session: str, source: str) -> list[str]:
    """The changed sources, in their order."""
    with use_db(session, WorkDB.Mode.open) as database:
        changes = observable([item.mutations[0] for item in database.work_items], source)
    random.Random(SEED).shuffle(changes)
    changed = [
        mutate_code(source, cosmic_ray.plugins.get_operator(one.operator_name)(**one.operator_args), one.occurrence)
        for one in changes
    ]
    return [code for code in changed if code is not None]


def watched(codes: list[str], module: str) -> Iterable[str]:
    """The same with a progress bar, on a terminal."""
    return track(codes, description=module, console=Console(stderr=True)) if sys.stderr.isatty() else codes


def tell(*lines: str) -> None:
    """At once, also into a file."""
    print(*lines, sep="\n", flush=True)


def judge(jury: Jury, source: str, every: list[str], wanted: slice) -> None:
    """Print each survivor and the score, however it ends."""
    judged = alive = 0
    try:
        for code in watched(every[wanted], jury.module):
            if jury.passes(code):
                alive += 1
                tell(*list(unified_diff(source.splitlines(), code.splitlines(), lineterm="", n=0))[2:])
            judged += 1
            if judged % REPORT_EVERY == 0 and not sys.stderr.isatty():
                tell(f"... {judged - alive} of {judged} noticed")
    finally:
        summary = f"{judged - alive} of {judged} noticed, {jury.endless} of them by never ending"
        tell(f"{jury.module}: {summary}; {len(every)} changes in all")


def main(session: str, module: str, tests: str, first: str = "0", at_most: str = "1000000") -> None:
    """Judge them, print the survivors and the score."""
    sys.path.insert(0, str(Path.cwd()))
    for number in (signal.SIGINT, signal.SIGTERM):  # in the background a shell has the first ignored
        signal.signal(number, signal.default_int_handler)
    file = Path(module.replace(".", "/") + ".py")
    source = file.read_text(encoding="utf-8")
    jury = Jury(module=module, file=file, tests=tests.split())
    with suppress(KeyboardInterrupt):
        jury.prepare()
        judge(jury, source, mutants(session, source), slice(int(first), int(first) + int(at_most)))


if __name__ == "__main__":
    if not 3 <= len(sys.argv[1:]) <= 5:
        raise SystemExit(__doc__)
    main(*sys.argv[1:])
