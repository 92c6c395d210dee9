"""The guided tests of the running session: at most one runs; each result goes into the trail once."""

from __future__ import annotations

from collections.abc import Callable

from app.console.state import SessionState
from app.outcomes.guided import GuidedRefusal, GuidedRun, GuidedStop, GuidedTest, advance, begin, refusal_of, result_of
from app.outcomes.guided import stop as stopped
from logs.reason import reason
from logs.records import GuidedTestResult


class GuidedTests:
    """Observes what control reports; nothing here reaches control."""

    def __init__(self, emit: Callable[[GuidedTestResult], object]) -> None:
        self.run: GuidedRun | None = None  # the one that runs
        self.results: list[GuidedTestResult] = []  # of this session, oldest first
        self._emit = emit

    def begin(self, test: GuidedTest, state: SessionState) -> GuidedRefusal | None:
        """Begin a test, if none runs; or why it can't begin."""
        refused = refusal_of(test, state.snapshot, fresh=state.snapshot_fresh)
        if refused is None and self.run is None and state.snapshot is not None:
            self.run = begin(test, state.snapshot, state.now_ns)
        return refused

    def update(self, state: SessionState) -> GuidedTestResult | None:
        """Take the session's newest state; the result, if the test has just ended."""
        if self.run is None:
            return None
        return self._settle(advance(self.run, state.snapshot, fresh=state.snapshot_fresh))

    def stop(self, why: GuidedStop) -> GuidedTestResult | None:
        """End the one that runs, not completed; None: none runs."""
        return None if self.run is None else self._settle(stopped(self.run, reason(why)))

    def clear(self) -> None:
        """Another session begins."""
        self.run, self.results = None, []

    def _settle(self, run: GuidedRun) -> GuidedTestResult | None:
        if not run.ended:
            self.run = run
            return None
        self.run, result = None, result_of(run)
        self.results.append(result)
        self._emit(result)
        return result
