"""What the application refuses, as a code with values; the wording is in the catalogues (`app/text`)."""

from __future__ import annotations

from enum import Enum


class AppError(Exception):
    """A configuration, process or session that can't go on. `str()` is for engineers, `render()` for users."""

    def __init__(self, code: Enum | str, **values: object) -> None:
        super().__init__(code, values)
        self.code = code
        self.values = values

    def __str__(self) -> str:
        if isinstance(self.code, str):  # until every code is an Enum's member
            return self.code
        return " ".join([str(self.code), *(f"{name}={value}" for name, value in self.values.items())])
