"""A session's result as tests need it: these trials, and nothing wrong besides."""

from __future__ import annotations

from collections.abc import Sequence

from app.demo.session import SessionResult
from app.demo.trial import Trial
from app.ipc.messages import Lateness


def session_of(trials: Sequence[Trial]) -> SessionResult:
    """A verified session of those trials without anything unintended."""
    return SessionResult(
        trials=tuple(trials),
        unintended=0,
        audit_verified=True,
        audit_detail="",
        perception_fps=30.0,
        lateness=Lateness(),
        session="s",
    )
