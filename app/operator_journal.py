"""Sign-ins and operators' changes that happen outside of a session, in a signed journal of their own."""

from __future__ import annotations

import time

from app.paths import Home
from logs.journal import OPERATORS, append_signed
from logs.keys import load_or_make_key
from logs.manifest import Moment
from logs.records import Body


def tell_operators_journal(home: Home, body: Body, operator: str = "") -> None:
    """Record it for good, or raise AuditError: who may not be recorded may not be let in."""
    now = Moment(wall_ns=time.time_ns(), monotonic_ns=time.monotonic_ns(), operator=operator)
    append_signed(home.logs / OPERATORS, "operators", [body], load_or_make_key(home.keys), now)
