"""What a session is started with: one frozen value, handed to every process."""

from __future__ import annotations

from pathlib import Path

from msgspec import Struct

from app.config import Config
from profiles.schema import Profile


class SessionSetup(Struct, frozen=True, kw_only=True):
    """Everything the processes of one session need to know at their start."""

    session: str  # name of the session, sortable: 20261121T093000Z-1a2b
    home: Path
    links: Path  # private directory of the sockets, 0700
    config: Config
    profile: Profile
    operator: str
    role: str = "therapist"
    console_pid: int = 0
