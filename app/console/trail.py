"""The console's own words in the audit trail; kept until a session with a trail runs, or the program ends."""

from __future__ import annotations

from app.audit.sink import AuditSink
from app.system.config import SessionSetup
from app.system.paths import Home
from logs.records import Body

_MOST_WAITING = 1000  # sign-ins before a session; a person types no more


class ConsoleTrail:
    """Queues records; sends them on as soon as there is a session to keep them in."""

    def __init__(self) -> None:
        self._sink: AuditSink | None = None
        self._waiting: list[Body] = []

    def open(self, setup: SessionSetup) -> None:
        """A session's audit process will listen."""
        self._sink = AuditSink(setup.links, "console", setup.operator)
        waiting, self._waiting = self._waiting, []
        for body in waiting:
            self.emit(body)

    def emit(self, body: Body) -> None:
        """Put one record in the trail."""
        if self._sink is not None:
            self._sink.emit(body)
        elif len(self._waiting) < _MOST_WAITING:
            self._waiting.append(body)

    def keep(self, home: Home) -> None:
        """What no session took goes into the operators' journal. Raises AuditError when the disk refuses."""
        from app.system.operators import tell_operators_journal  # brings cryptography: not before the first paint

        waiting, self._waiting = self._waiting, []
        for body in waiting:
            tell_operators_journal(home, body)

    def close(self) -> None:
        """The session ends."""
        if self._sink is not None:
            self._sink.close()
            self._sink = None
