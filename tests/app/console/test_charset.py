"""Terminals without Unicode or braille: what they get is ASCII, as wide, and still says what it said."""

from __future__ import annotations

import os
import pty

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from app.console.charset import Substitutes, substitutes_for
from app.console.terminal_output import TerminalOutput
from tests.app.console.test_sizes import PANELS, READY, text_of
from tests.support.catalogues import entries

ASCII = Substitutes(braille_only=False)


@given(st.characters(min_codepoint=0x20))
def test_a_substitute_is_ascii_and_as_wide(letter: str) -> None:
    substitute = letter.translate(ASCII)
    assert substitute.isascii()
    assert cell_len(substitute) == cell_len(letter) or letter.isascii()


def test_nothing_of_the_english_console_is_lost() -> None:
    texts = [form for forms in entries("en").values() for form in forms]
    texts += [text_of(draw(READY, 120, 30)) for draw in PANELS.values()]
    lost = {letter for text in texts for letter in text if letter.translate(ASCII).strip(" ") == "?" != letter}
    assert lost <= set("βσλφδΔµ²³⇧Ω")  # of evaluations' tables and drives


def test_signs_that_mean_something_keep_their_meaning() -> None:
    assert "−5.0° ± 2 cm, 3 × 4, ≤ 20, → 7".translate(ASCII) == "-5.0o + 2 cm, 3 x 4, < 20, > 7"
    assert "████▌···░░ ▁▃▅▇".translate(ASCII) == "#####..... __##"


def test_braille_keeps_its_shape() -> None:
    assert "⠉⣀⣉⣿⠀".translate(ASCII) == "'.:# "


@pytest.mark.parametrize(
    ("environment", "shown"),
    [
        ({"LANG": "en_US.UTF-8", "TERM": "xterm"}, "■ STOP ⣿"),
        ({"TERM": "xterm"}, "■ STOP ⣿"),
        ({"LANG": "en_US.UTF-8", "TERM": "linux"}, "■ STOP #"),
        ({"LC_ALL": "C", "LANG": "en_US.UTF-8", "TERM": "xterm"}, "# STOP #"),
        ({"LANG": "de_DE.ISO-8859-1"}, "# STOP #"),
    ],
)
def test_the_terminal_gets_what_it_can_show(environment: dict[str, str], shown: str) -> None:
    host, terminal = pty.openpty()
    output = TerminalOutput(terminal, lost=lambda: None, repaint=lambda: None, substitutes=substitutes_for(environment))
    output.write("\x1b[1m■ STOP ⣿")
    output.close()
    assert os.read(host, 1000).decode() == f"\x1b[1m{shown}"
    os.close(host)
    os.close(terminal)
