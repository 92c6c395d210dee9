"""What hardware refuses: a code with values, worded in the catalogues (domain hal)."""

from __future__ import annotations

from enum import Enum


class HardwareError(Exception):
    """A device that is missing, broken or misconfigured. The text of `code` says what, where and what to do."""

    def __init__(self, code: Enum | str, **values: object) -> None:
        super().__init__(code if isinstance(code, str) else code.name, *([values] if values else []))
        self.code = code
        self.values = values

    def __str__(self) -> str:
        name = self.code if isinstance(self.code, str) else self.code.name
        return " ".join([name, *(f"{key}={value}" for key, value in self.values.items())])
