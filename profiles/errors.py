"""What profiles refuse: a code with values, worded in the catalogues (domain profiles)."""

from __future__ import annotations

from enum import Enum


class ProfileError(Exception):
    """A profile that is missing, broken or out of range. The text of `code` says which field, its range, what to do."""

    def __init__(self, code: Enum | str, **values: object) -> None:
        super().__init__(code if isinstance(code, str) else code.name, *([values] if values else []))
        self.code = code
        self.values = values

    def __str__(self) -> str:
        name = self.code if isinstance(self.code, str) else self.code.name
        return " ".join([name, *(f"{key}={value}" for key, value in self.values.items())])
