"""Which command changes something, and how the command line learns whose change it is.

Every command stands in one of the two tables; `tests/app/cli/test_permission.py` walks the command tree and tries
each. Where nobody is enrolled and the joints are simulated, changes are unsigned and recorded as that.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from app.system.errors import AppError
from app.system.operators import Permission, append_to_journal
from app.system.paths import Home, find_home
from app.text.catalogue import tr
from logs.reason import reason

if TYPE_CHECKING:
    from app.system.authority import Authority

TOKEN_VARIABLE = "RLEEX_TOKEN"  # names a file that `rleex operator token` has written

# Command → the permission it asks for, and the arguments without which it only reads.
CHANGES: dict[str, tuple[Permission, tuple[str, ...]]] = {
    "camera calibrate": (Permission.CALIBRATE, ()),
    "can doctor": (Permission.CONFIGURE, ()),  # asks the drives, unless it only listens
    "can scan": (Permission.CONFIGURE, ()),  # disables drives that are enabled
    "can zero": (Permission.CONFIGURE, ()),
    "configure": (Permission.CONFIGURE, ()),
    "emulate-drives": (Permission.CONFIGURE, ()),  # answers in the drives' place
    "link forget": (Permission.CONFIGURE, ()),
    "link pair": (Permission.CONFIGURE, ()),
    "model": (Permission.CONFIGURE, ("--again",)),
    "operator add": (Permission.MANAGE_OPERATORS, ()),
    "operator disable": (Permission.MANAGE_OPERATORS, ()),
    "operator pin": (Permission.MANAGE_OPERATORS, ()),
    "operator token": (Permission.EDIT_PATIENTS, ()),  # of those it is given
    "profile archive": (Permission.EDIT_PATIENTS, ()),
    "profile calibrate": (Permission.CALIBRATE, ()),
    "profile import": (Permission.EDIT_PATIENTS, ()),
    "profile new": (Permission.EDIT_PATIENTS, ()),
    "profile set": (Permission.EDIT_PATIENTS, ()),
    "recording delete-pictures": (Permission.EDIT_PATIENTS, ()),
    "recording expire": (Permission.EDIT_PATIENTS, ()),
    "simulate": (Permission.OPERATE, ("--preflight",)),
}
# Writes nothing but what its options name, and a demonstration's own session. `run` asks in the console itself.
READS = frozenset(
    {
        *(
            f"audit {name}"
            for name in (
                "explain",
                "export",
                "key",
                "list",
                "merge",
                "query",
                "replay",
                "report",
                "schema",
                "show",
                "verify",
            )
        ),
        *(f"camera {name}" for name in ("compare", "list", "show")),
        *(f"can {name}" for name in ("decode", "monitor", "record")),
        *(f"profile {name}" for name in ("export", "history", "list", "show")),
        *(f"recording {name}" for name in ("info", "schema", "verify")),
        "demo",  # simulated joints, or emulated drives on a bus of its own
        "doctor",
        "export",
        "query",
        "joints",  # its sessions are begun by an operator who signs in at the laptop
        "replay",
        "link list",
        "locate",
        "operator list",
        "outcomes",
        "press-input",  # a simulated button, which stops; nothing moves by letting it go
        "run",
    }
)  # and every `evaluate`


def sign_in(home: Path | None, permission: Permission) -> Authority:
    """Whose change it will be: by token, by name and PIN, or unsigned where nothing real can move.

    Raises AppError when they may not, or when there is no terminal to ask.
    """
    from app.system.authority import AuthorityFault, unsigned
    from app.system.enrolment import by_token

    place = find_home(home)
    token = os.environ.get(TOKEN_VARIABLE)
    if token:
        authority = by_token(place, Path(token))
    else:
        try:
            authority = unsigned(place)
        except AppError as error:
            if error.code is not AuthorityFault.SIGN_IN_NEEDED:
                raise
            authority = ask(place)
    authority.require(permission)
    return authority


def ask(place: Home) -> Authority:
    """Name and PIN, on a terminal; a wrong one is counted and recorded. Raises AppError."""
    from app.system.authority import AuthorityFault, sign_in_by_pin
    from logs.records import SignInFailed

    if not is_terminal():
        raise AppError(AuthorityFault.SIGN_IN_NEEDED)
    name: str = typer.prompt(tr("sign_in.name"))
    pin: str = typer.prompt(tr("sign_in.pin"), hide_input=True)
    authority, result = sign_in_by_pin(place, name, pin, time.time())
    if authority is None:
        assert result.fault is not None
        cause = reason(result.fault)
        append_to_journal(place, SignInFailed(name=name, reason=cause, failures=result.failures, wait_s=result.wait_s))
        raise AppError(result.fault, wait_s=result.wait_s)
    return authority


def is_terminal() -> bool:
    """Whether there is somebody to ask."""
    return sys.stdin.isatty()
