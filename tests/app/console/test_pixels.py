"""Real pixels: which terminals are believed, that no answer is read as keys, and what is written to them."""

from __future__ import annotations

import base64
import re
from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from textual.events import Key

from app.console.app import ConsoleApp
from app.console.pixels import (
    KITTY_REMOVAL,
    PREVIEW_PX,
    SIXEL_PX,
    SIXEL_PX_A_SECOND,
    Answers,
    PixelPicture,
    PixelTerminal,
    Protocol,
    asks,
    kitty_picture,
    placed,
    sixels,
)
from app.console.terminal import parser_without
from app.console.widgets.picture import Picture
from testing.messages import gradient
from tests.app.console.conftest import Opener

KITTY, CELL = "\x1b_Gi=31;OK\x1b\\", "\x1b[6;20;10t"
PLAIN, SIXEL = "\x1b[?62;22c", "\x1b[?62;4;22c"


def found_in(*reads: str, cell_px: tuple[int, int] = (0, 0)) -> tuple[list[PixelTerminal], str]:
    """What is found, and what is left for the keys."""
    found: list[PixelTerminal] = []
    answers = Answers(found.append, cell_px)
    return found, "".join([answers.take(read) for read in reads])


@pytest.mark.parametrize(
    ("said", "cell_px", "protocol"),
    [
        (KITTY + CELL + PLAIN, (0, 0), Protocol.KITTY),
        (CELL + SIXEL, (0, 0), Protocol.SIXEL),
        (KITTY + CELL + SIXEL, (0, 0), Protocol.SIXEL),
        (SIXEL, (10, 20), Protocol.SIXEL),  # xterm does not tell its cells, the kernel does
        (CELL + PLAIN, (0, 0), None),
        (KITTY + PLAIN, (0, 0), None),  # pixels, but nobody knows how many
        ("\x1b_Gi=31;ENOTSUPPORTED:no\x1b\\" + CELL + PLAIN, (0, 0), None),
        ("\x1b[6;0;0t" + SIXEL, (10, 20), None),  # cells that no font has
        ("\x1b[6;9999;9999t" + SIXEL, (10, 20), None),
        ("\x1b[?4c" + CELL, (10, 20), None),  # 4 as the terminal's class is not sixel
        ("", (10, 20), None),
    ],
)
def test_a_terminal_is_believed_when_its_answers_fit(
    said: str, cell_px: tuple[int, int], protocol: Protocol | None
) -> None:
    found, rest = found_in(said, cell_px=cell_px)
    assert rest == ""
    assert [one.protocol for one in found] == ([] if protocol is None else [protocol])
    assert all((one.cell_width_px, one.cell_height_px) == (10, 20) for one in found)


KEYS = st.lists(st.sampled_from([" ", "k", "\x1b[A", "\x1b[6;5~", "\x1b[6~", "\x1b[32;1u", "é"]), max_size=3).map(
    "".join
)


@given(keys=st.tuples(KEYS, KEYS, KEYS, KEYS), cuts=st.sets(st.integers(1, 60)))
def test_keys_come_through_in_order_and_answers_do_not(keys: tuple[list[str], ...], cuts: set[int]) -> None:
    said = "".join("".join(key) + answer for key, answer in zip(keys, (KITTY, CELL, SIXEL, ""), strict=True))
    kept = {cut for cut in cuts if cut < len(said) and said[cut - 1] != "\x1b"}  # there it is the Escape key
    at = sorted({0, *kept, len(said)})
    _, rest = found_in(*(said[begin:end] for begin, end in pairwise(at)))
    assert rest == "".join("".join(key) for key in keys)


def test_stop_is_never_kept_back() -> None:
    for begun in ("\x1b_G", "\x1b_Gi=31;", "\x1b[?", "\x1b[?62;", "\x1b[6;2"):
        _, rest = found_in(f"{begun} ")
        assert rest == f"{begun} "


def test_the_parser_gives_keys_and_no_answers() -> None:
    found: list[PixelTerminal] = []
    parser = parser_without(Answers(found.append))()
    events = [event for read in ("s" + KITTY + CELL[:4], CELL[4:] + PLAIN, " ") for event in parser.feed(read)]
    assert [event.key for event in events if isinstance(event, Key)] == ["s", "space"]
    assert found == [PixelTerminal(Protocol.KITTY, 10, 20)]


@pytest.mark.parametrize(
    ("environment", "asked"),
    [
        ({"TERM": "xterm-256color", "LANG": "C.UTF-8"}, True),
        ({"TERM": "xterm-kitty"}, True),
        ({"TERM": "linux"}, False),
        ({"TERM": "dumb"}, False),
        ({"TERM": "vt100"}, False),
        ({}, False),
        ({"TERM": "xterm", "LC_ALL": "C"}, False),
    ],
)
def test_a_terminal_that_would_print_the_question_is_not_asked(environment: dict[str, str], asked: bool) -> None:
    assert asks(environment) is asked


def test_kitty_gets_the_picture_itself_in_pieces_it_takes() -> None:
    pixels = np.random.default_rng(1).integers(0, 255, (54, 96, 3), dtype=np.uint8)
    sent = re.findall(r"\x1b_G([^;\x1b]*);?([^\x1b]*)\x1b\\", kitty_picture(pixels, 1, 40, 12))
    *chunks, (removal, _) = sent
    assert all(len(data) <= 4096 for _, data in chunks)
    assert [f"m={int(at < len(chunks) - 1)}" in keys for at, (keys, _) in enumerate(chunks)] == [True] * len(chunks)
    assert "c=40,r=12,C=1" in chunks[0][0]
    png = base64.b64decode("".join(data for _, data in chunks))
    decoded = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    assert np.array_equal(decoded[..., ::-1], pixels)
    shown = re.findall(r"i=(\d+)", chunks[0][0])
    assert removal.startswith("a=d,d=I")
    assert re.findall(r"i=(\d+)", removal) != shown


def test_sixels_fill_whole_bands_and_no_more() -> None:
    pixels = np.full((47, 90, 3), 200, dtype=np.uint8)
    assert '"1;1;90;42' in sixels(pixels)
    assert placed("S", 3, 5) == "\x1b7\x1b[6;4HS\x1b8"


@given(
    columns=st.integers(0, 300), rows=st.integers(0, 100), across=st.integers(4, 40), protocol=st.sampled_from(Protocol)
)
def test_a_picture_fits_its_room_and_its_budget(columns: int, rows: int, across: int, protocol: Protocol) -> None:
    made = PixelPicture.fit(PixelTerminal(protocol, across, 2 * across), columns, rows)
    area_px = columns * rows * 2 * across**2
    if made is None:
        assert area_px == 0 or (protocol is Protocol.SIXEL and area_px > SIXEL_PX)
        return
    wanted = made.wanted
    assert wanted.preview_hz is not None
    assert 2 < wanted.preview_hz <= 8
    assert protocol is Protocol.KITTY or wanted.preview_hz * area_px <= SIXEL_PX_A_SECOND * 1.001
    assert wanted.preview_width_px is not None
    assert 32 <= wanted.preview_width_px <= PREVIEW_PX
    shown_columns, shown_rows = made.cells(gradient())
    assert shown_columns <= max(1, columns)
    assert shown_rows <= max(1, rows)


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What goes to the terminal for pictures."""
    found: list[str] = []
    monkeypatch.setattr(Picture, "_write", lambda _, data, **__: found.append(data))
    return found


def shows_pixels(app: ConsoleApp, protocol: Protocol) -> None:
    """As when the terminal has answered."""
    app._found_pixels(PixelTerminal(protocol, 8, 16))


async def test_pixels_are_drawn_where_the_picture_is_and_go_with_a_dialog(console: Opener, written: list[str]) -> None:
    async with console() as opened:
        shows_pixels(opened.app, Protocol.KITTY)
        host = opened.host
        await opened.until(lambda: any(one.preview_hz == 8.0 for one in host.perception_commands))
        host.picture = gradient(97)
        await opened.until(lambda: written)
        picture = opened.app.screen.query_one(Picture)
        row, column = map(int, re.findall(r"\x1b\[(\d+);(\d+)H", written[0])[0])
        assert picture.region.contains(column - 1, row - 1)
        await opened.press("i")
        await opened.until(lambda: written[-1] == KITTY_REMOVAL)


async def test_without_colours_no_pixels(console: Opener, written: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    async with console() as opened:
        shows_pixels(opened.app, Protocol.SIXEL)
        await opened.pilot.pause()
        assert opened.app.screen.query_one(Picture)._pixels is None
        assert written == []
