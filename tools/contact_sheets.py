"""One sheet a screen: its sizes side by side, a row for each theme and language, drawn cell by cell.

Drawn from the cells themselves and not from the SVG, so a sheet shows exactly what a terminal's grid would: what is
cut is cut, what is too wide pushes nothing aside. Block elements and braille are drawn as shapes, because few fonts
have both.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont
from rich.cells import cell_len
from rich.color import Color
from rich.style import Style
from rich.terminal_theme import DEFAULT_TERMINAL_THEME
from textual.strip import Strip

CELL_W, CELL_H = 6, 12  # px; DejaVu Sans Mono of 10 px is 6.02 wide
FONT_PX = 10
GAP_PX, TITLE_PX = 10, 16
COLOURS = 128  # of a sheet's palette
BRAILLE = range(0x2800, 0x2900)
DOTS = ((0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2), (0, 3), (1, 3))  # column and row of each bit
BLOCKS = {  # left, top, right, bottom as shares of the cell
    "▀": (0, 0, 1, 0.5),
    "▄": (0, 0.5, 1, 1),
    "█": (0, 0, 1, 1),
    "▌": (0, 0, 0.5, 1),
    "▐": (0.5, 0, 1, 1),
    "▔": (0, 0, 1, 0.125),
    **{chr(0x2580 + eighths): (0, 1 - eighths / 8, 1, 1) for eighths in range(1, 8)},
    **{chr(0x2590 - eighths): (0, 0, eighths / 8, 1) for eighths in range(1, 8)},
}
FONTS = (
    "/usr/share/fonts/truetype/dejavu/DejaVuSansMono.ttf",
    "/usr/share/fonts/truetype/wqy/wqy-microhei.ttc",  # Debian: fonts-wqy-microhei
    "/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf",
)
Rgb = tuple[int, int, int]


@cache
def _font(wide: bool, scale: int) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(FONTS[1 if wide else 0], FONT_PX * scale)


def cells_image(strips: Iterable[Strip], scale: int = 1) -> Image.Image:
    """A screen as pixels, one cell 6 × 12 of them times the scale. Raises OSError without the fonts."""
    lines = list(strips)
    width, height = CELL_W * scale, CELL_H * scale
    image = Image.new("RGB", (max(line.cell_length for line in lines) * width, len(lines) * height))
    draw = ImageDraw.Draw(image)
    for y, line in enumerate(lines):
        x = 0
        for segment in line:
            ink, paper = _colours(segment.style)
            if not segment.cell_length:
                continue
            draw.rectangle((x, y * height, x + segment.cell_length * width - 1, (y + 1) * height - 1), fill=paper)
            for letter in segment.text:
                _letter(draw, letter, (x, y * height), ink, scale, bold=bool(segment.style and segment.style.bold))
                x += cell_len(letter) * width
    return image


def _colours(style: Style | None) -> tuple[Rgb, Rgb]:
    style = style or Style()
    ink, paper = _rgb(style.color, foreground=True), _rgb(style.bgcolor, foreground=False)
    return (paper, ink) if style.reverse else (ink, paper)


def _rgb(color: Color | None, *, foreground: bool) -> Rgb:
    red, green, blue = (color or Color.default()).get_truecolor(DEFAULT_TERMINAL_THEME, foreground)
    return red, green, blue


def _letter(draw: ImageDraw.ImageDraw, letter: str, at: tuple[int, int], ink: Rgb, scale: int, *, bold: bool) -> None:
    if letter == " ":
        return
    (x, y), width, height = at, CELL_W * scale, CELL_H * scale
    if letter in BLOCKS:
        left, top, right, bottom = BLOCKS[letter]
        end = (x + round(right * width) - 1, y + round(bottom * height) - 1)
        draw.rectangle((x + round(left * width), y + round(top * height), *end), fill=ink)
    elif ord(letter) in BRAILLE:
        side = scale
        for bit, (column, row) in enumerate(DOTS):
            if ord(letter) - BRAILLE.start & 1 << bit:
                dot_x, dot_y = x + (1 + 3 * column) * scale, y + (1 + 3 * row) * scale
                draw.rectangle((dot_x, dot_y, dot_x + side, dot_y + side), fill=ink)
    else:
        draw.text((x, y), letter, ink, _font(cell_len(letter) > 1, scale), stroke_width=0)
        if bold:
            draw.text((x + 1, y), letter, ink, _font(cell_len(letter) > 1, scale))


def sheet(shots: Mapping[tuple[str, str], list[Strip]]) -> Image.Image:
    """All shots by row and column, each named above it; a row is as high as its highest, a column as wide."""
    images = {key: cells_image(strips) for key, strips in shots.items()}
    rows, columns = (list(dict.fromkeys(key[at] for key in images)) for at in (0, 1))
    widths = [max(images[row, column].width for row in rows) for column in columns]
    heights = [TITLE_PX + max(images[row, column].height for column in columns) for row in rows]
    whole = Image.new("RGB", (sum(widths) + GAP_PX * (len(widths) + 1), sum(heights) + GAP_PX * (len(heights) + 1)))
    draw = ImageDraw.Draw(whole)
    draw.rectangle((0, 0, *whole.size), fill="#808080")
    for i, row in enumerate(rows):
        for j, column in enumerate(columns):
            x, y = GAP_PX * (j + 1) + sum(widths[:j]), GAP_PX * (i + 1) + sum(heights[:i])
            draw.text((x, y), f"{row}, {column}", "#ffffff", _font(wide=False, scale=1))
            whole.paste(images[row, column], (x, y + TITLE_PX))
    return whole


def save(image: Image.Image, path: Path) -> None:
    """As a PNG with a palette: a third of the size."""
    path.parent.mkdir(parents=True, exist_ok=True)
    image.quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)
