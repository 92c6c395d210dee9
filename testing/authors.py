"""Who changes something in a test: a name alone for the profile store, a sign-in where one is asked for."""

from __future__ import annotations

from dataclasses import dataclass

from app.system.authority import Authority, Proof, of_operator
from app.system.operators import Operator, Role
from app.system.paths import Home
from profiles.store import Change


@dataclass(frozen=True)
class Named:
    """An author whom everything is allowed."""

    name: str

    def change_profile(self, patient: str, change: Change) -> None:
        """Allow it."""


def signed_in(home: Home, role: Role = Role.ENGINEER, name: str = "Ada") -> Authority:
    """As signing in by PIN gives it."""
    return of_operator(home, Operator(name=name, role=role, pin_hash=""), Proof.PIN)
