"""A CAN bus whose adapter fails."""

from __future__ import annotations

import can


class BreakingBus(can.BusABC):
    """A bus that fails as it is told to."""

    def __init__(self, sending: Exception | None = None, receiving: Exception | None = None) -> None:
        super().__init__(channel="breaking")
        self.sending, self.receiving = sending, receiving

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.sending is not None:
            raise self.sending

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if self.receiving is not None:
            raise self.receiving
        return None, False
