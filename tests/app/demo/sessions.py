"""A session's result as tests need it: these attempts, and nothing wrong besides."""

from __future__ import annotations

from collections.abc import Sequence

from app.demo.scenario import Attempt
from app.demo.session import SessionResult
from app.ipc.snapshot import Lateness


def session_of(attempts: Sequence[Attempt]) -> SessionResult:
    """A verified session of those attempts without anything unintended."""
    return SessionResult(
        attempts=tuple(attempts),
        unintended=0,
        audit_verified=True,
        audit_detail="",
        perception_fps=30.0,
        lateness=Lateness(),
        session="s",
    )
