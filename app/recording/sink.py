"""A process's end of the recording's queue: never waits; what a full queue refuses is counted."""

from __future__ import annotations

from msgspec import Struct

from app.ipc.links import OrderedSender, address
from app.ipc.streams import LinkDirectory, Stream

QUEUE = 400  # messages: 20 s of control's; more would let a stalled disk grow control's locked memory


class RecordingSink:
    """Sends what is to be recorded."""

    def __init__(self, links: LinkDirectory, stream: Stream, queue: int = QUEUE) -> None:
        self.lost = 0  # messages, since the start
        self._sender = OrderedSender(address(links, stream.name), queue=queue)

    def send(self, message: Struct) -> bool:
        """Queue it; False when it was refused."""
        sent = self._sender.send(message)
        self.lost += not sent
        return sent

    def close(self, linger_s: float = 0.5) -> None:
        """Let what is queued leave."""
        self._sender.close(linger_s)
