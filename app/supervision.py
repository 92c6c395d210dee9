"""When perception must be started again: it died, or it has gone silent as a frozen driver does."""

from __future__ import annotations

from dataclasses import dataclass

# Loading the hand model takes up to three seconds on a cold disk; after its first report a second's silence
# is thirty missed frames.
FIRST_REPORT_S = 15.0
SILENCE_S = 2.0
BACK_OFF_S = (1.0, 2.0, 4.0, 8.0, 16.0)


@dataclass(slots=True)
class Supervisor:
    """Decides on restarts with a growing back-off; gives up after as many as the back-off has steps."""

    restarts: int = 0
    _last_report_s: float | None = None
    _started_s: float | None = None
    _failed_s: float | None = None

    def must_restart(self, now_s: float, *, alive: bool, reported: bool) -> bool:
        """Whether to start perception again now; counts it when so."""
        if self._started_s is None:
            self._started_s = now_s
        if reported:
            self._last_report_s = now_s
        if alive and not self._silent(now_s):
            self._failed_s = None
            return False
        if self._failed_s is None:
            self._failed_s = now_s
        if self.restarts >= len(BACK_OFF_S) or now_s - self._failed_s < BACK_OFF_S[self.restarts] - 1.0:
            return False
        self.restarts += 1
        self._started_s, self._last_report_s, self._failed_s = now_s, None, None
        return True

    def _silent(self, now_s: float) -> bool:
        if self._last_report_s is None:
            assert self._started_s is not None
            return now_s - self._started_s > FIRST_REPORT_S
        return now_s - self._last_report_s > SILENCE_S
