"""What a terminal that lacks Unicode, or a font with braille, gets in its place: one sign a cell. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from unicodedata import combining, normalize

from rich.cells import cell_len

_BRAILLE = range(0x2800, 0x2900)
_UPPER = 0x01 | 0x02 | 0x08 | 0x10  # the dots of a cell's upper half
_DENSE = 5  # dots
_SIGNS = {
    "═━─▔╌": "=--~-",
    "│┃┆‖": "||||",
    "┌┐└┘├┤┬┴┼╭╮╰╯┏┓┗┛": "+" * 17,
    "▀▄█▌▐▋▊▉▅▆▇▓": "#" * 12,
    "▏▎▍▁▂▃░▒": "|||___.:",
    "■●◉○◎◐▶▸◀▷◁▲▼△▽": "#*@oO%>><><^v^v",
    "✓✗✎‼…·•–—−±×°→←↑↓⏎": "vxe!...---+xo><^v<",
    "“”‘’≈≤≥": "\"\"''~<>",
}
_TABLE = {before: after for befores, afters in _SIGNS.items() for before, after in zip(befores, afters, strict=True)}


class Substitutes(dict[int, str]):
    """For `str.translate`: ASCII stays; the rest is replaced by as many signs as it takes cells."""

    def __init__(self, *, braille_only: bool) -> None:
        super().__init__()
        self._braille_only = braille_only

    def __missing__(self, code: int) -> str:
        letter = chr(code)
        kept = code < 0x80 or (self._braille_only and code not in _BRAILLE)
        self[code] = letter if kept else _ascii(letter)
        return self[code]


def substitutes_for(environment: Mapping[str, str]) -> Substitutes | None:
    """None: the terminal shows everything. A locale that isn't UTF-8 gets ASCII; Linux's console has no braille."""
    locale = environment.get("LC_ALL") or environment.get("LC_CTYPE") or environment.get("LANG", "")
    if locale and "utf" not in locale.lower():
        return Substitutes(braille_only=False)
    return Substitutes(braille_only=True) if environment.get("TERM") == "linux" else None


@lru_cache(maxsize=4096)
def _ascii(letter: str) -> str:
    dots = ord(letter) - _BRAILLE.start
    if 0 <= dots < len(_BRAILLE):
        if dots & _UPPER and dots & ~_UPPER:
            return "#" if dots.bit_count() >= _DENSE else ":"
        return "'" if dots & _UPPER else "." if dots else " "
    plain = "".join(part for part in normalize("NFKD", letter) if not combining(part))
    width = cell_len(letter)
    found = _TABLE.get(letter) or (plain if plain.isascii() and len(plain) == width else "")
    return found or "?" * width
