"""What the console needs of a session's host; `app.session.host.SessionHost` is the real one, tests own one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from app.ipc.messages import HandCommand, OperatorKind, PerceptionCommand
from app.ipc.states import Action
from app.session.host import Latest
from app.system.config import SessionSetup


class Host(Protocol):
    """Processes and links of one session. `send` may be called from any thread."""

    setup: SessionSetup

    def start(self) -> None:
        """Start the processes; may take a second."""
        ...

    def close(self) -> None:
        """Bring the legs to rest and the processes to their end; harmless when done twice."""
        ...

    def send(self, kind: OperatorKind, action: Action | None = None, note: str = "") -> int:
        """The operator's word to control; its sequence comes back in the snapshot."""
        ...

    def beat(self) -> None:
        """The event loop is alive."""
        ...

    def move_hand(self, command: HandCommand) -> None:
        """Move the digital hand."""
        ...

    def tell_perception(self, command: PerceptionCommand) -> None:
        """Change what the picture looks like."""
        ...

    def poll(self) -> Latest:
        """The newest of each stream, without waiting."""
        ...


HostFactory = Callable[[SessionSetup], Host]
