"""How the command line learns whose change it is.

`tests/app/cli/test_permission.py` says of each command whether it reads or changes, and tries every one. Where nobody
is enrolled and the joints are simulated, changes are unsigned and recorded as that.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from app.system.errors import AppError
from app.system.journals import append_to_journal
from app.system.operators import Permission
from app.system.paths import Home, find_home
from app.text.catalogue import tr
from logs.reason import reason

if TYPE_CHECKING:
    from app.system.authority import Authority

TOKEN_VARIABLE = "RLEEX_TOKEN"  # names a file that `rleex operator token` has written


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
