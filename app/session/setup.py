"""The setup of a new session: who may begin it, its name, and its private directory of sockets."""

from __future__ import annotations

import secrets
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path

from app.ipc.links import new_link_directory
from app.system.authority import Authority, AuthorityFault
from app.system.config import Config, Purpose, SessionSetup
from app.system.errors import AppError
from app.system.operators import Permission, needs_sign_in
from app.system.paths import Home
from profiles.schema import Profile

LONGEST_PLACE = 60  # of a socket's 107 bytes (unix(7)); folder and longest stream (`app/ipc/streams.py`) take 34


def make_setup(
    home: Home,
    config: Config,
    profile: Profile,
    authority: Authority | None,
    permission: Permission | None = Permission.OPERATE,
    *,
    purpose: Purpose = "session",
) -> SessionSetup:
    """Name a session and give it its private directory of sockets.

    Real joints ask for the permission; None: nothing will move, somebody watches. Raises AppError when it is not there.
    """
    if permission is not None and needs_sign_in(config):
        if authority is None:
            raise AppError(AuthorityFault.SIGN_IN_NEEDED)
        from app.system.configure import record_outside_change  # brings the trail's readers

        authority.require(permission)
        record_outside_change(home, authority.name, authority.role_name, authority.proof)
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    return SessionSetup(
        session=f"{stamp}-{secrets.token_hex(2)}",
        home=home.root,
        links=new_link_directory(_socket_folder()),
        config=config,
        profile=profile,
        operator=authority.name if authority else "",
        role=authority.role_name if authority else "",
        began_ns=time.monotonic_ns(),
        purpose=purpose,
    )


def _socket_folder() -> Path:
    """A new one (0700), in /tmp where the temporary folder's name is too long for a socket, or none for ZeroMQ."""
    place = tempfile.gettempdir()
    usable = place.isascii() and len(place) <= LONGEST_PLACE
    return Path(tempfile.mkdtemp(prefix="rleex-", dir=place if usable else "/tmp"))
