"""Letters of half blocks, as large as fits: words that are read from across the room. Pure.

Only what the font has: capitals, digits and some signs. Terminals have no larger letters, and a font of Chinese
characters would be larger than the console.
"""

from __future__ import annotations

from functools import lru_cache

ROWS = 5  # dots of a letter, each as wide as high: a cell wide, half a cell high
LARGEST = 10  # cells a dot
_FONT = {
    "A": ".##. #..# #### #..# #..#",
    "B": "###. #..# ###. #..# ###.",
    "C": ".### #... #... #... .###",
    "D": "###. #..# #..# #..# ###.",
    "E": "#### #... ###. #... ####",
    "F": "#### #... ###. #... #...",
    "G": ".### #... #.## #..# .###",
    "H": "#..# #..# #### #..# #..#",
    "I": "### .#. .#. .#. ###",
    "J": "..## ...# ...# #..# .##.",
    "K": "#..# #.#. ##.. #.#. #..#",
    "L": "#... #... #... #... ####",
    "M": "#...# ##.## #.#.# #...# #...#",
    "N": "#..# ##.# #.## #..# #..#",
    "O": ".##. #..# #..# #..# .##.",
    "P": "###. #..# ###. #... #...",
    "Q": ".##. #..# #..# #.## .###",
    "R": "###. #..# ###. #.#. #..#",
    "S": ".### #... .##. ...# ###.",
    "T": "##### ..#.. ..#.. ..#.. ..#..",
    "U": "#..# #..# #..# #..# .##.",
    "V": "#...# #...# #...# .#.#. ..#..",
    "W": "#...# #...# #.#.# ##.## #...#",
    "X": "#...# .#.#. ..#.. .#.#. #...#",
    "Y": "#...# .#.#. ..#.. ..#.. ..#..",
    "Z": "#### ...# .##. #... ####",
    "0": ".##. #..# #..# #..# .##.",
    "1": ".#. ##. .#. .#. ###",
    "2": "###. ...# .##. #... ####",
    "3": "###. ...# .##. ...# ###.",
    "4": "#..# #..# #### ...# ...#",
    "5": "#### #... ###. ...# ###.",
    "6": ".##. #... ###. #..# .##.",
    "7": "#### ...# ..#. .#.. .#..",
    "8": ".##. #..# .##. #..# .##.",
    "9": ".##. #..# .### ...# .##.",
    ".": ". . . . #",
    ",": ". . . # #",
    "-": "... ... ### ... ...",
    "%": "#..#. ...#. ..#.. .#... .#..#",
    "<": "..# .#. #.. .#. ..#",
    "?": "##. ..# .#. ... .#.",
    " ": ".. .. .. .. ..",
}


@lru_cache(maxsize=64)  # the same words are asked for twenty times a second
def large(text: str, width: int, height: int) -> tuple[str, ...]:
    """Rows of half blocks, broken between words; none where a letter is missing or there is no room for them."""
    parts = text.upper().split()
    if not parts or any(letter not in _FONT for part in parts for letter in part):
        return ()
    for scale in range(LARGEST, 0, -1):
        lines = _broken(parts, width // scale)
        rows_of_line = -(-ROWS * scale // 2)
        if lines and len(lines) * (rows_of_line + 1) - 1 <= height:
            rows = [row for line in lines for row in (*_drawn(line, scale), "")]
            return tuple(rows[:-1])
    return ()


def _width(text: str) -> int:
    return sum(len(_FONT[letter].split()[0]) + 1 for letter in text) - 1


def _broken(parts: list[str], dots: int) -> list[str]:
    """Lines of so many dots; none where a word is wider."""
    lines: list[str] = []
    for part in parts:
        if _width(part) > dots:
            return []
        if lines and _width(f"{lines[-1]} {part}") <= dots:
            lines[-1] = f"{lines[-1]} {part}"
        else:
            lines.append(part)
    return lines


def _drawn(line: str, scale: int) -> list[str]:
    """A line of letters: two rows of dots a row of cells."""
    rows = [".".join(_FONT[letter].split()[row] for letter in line) for row in range(ROWS)]
    dots = ["".join(dot * scale for dot in row) for row in rows for _ in range(scale)]
    dots += ["." * len(dots[0])] * (len(dots) % 2)
    return [
        "".join(_HALF[upper + lower] for upper, lower in zip(dots[row], dots[row + 1], strict=True)).rstrip()
        for row in range(0, len(dots), 2)
    ]


_HALF = {"..": " ", "#.": "▀", ".#": "▄", "##": "█"}
