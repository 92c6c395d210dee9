"""Compiles the catalogues (.po) to what gettext reads (.mo), where they are newer: `python -m app.text.compile`."""

from __future__ import annotations

import os
from pathlib import Path

from babel.messages.mofile import write_mo
from babel.messages.pofile import read_po

LOCALES = Path(__file__).with_name("locales")


def compile_catalogues(folder: Path = LOCALES) -> list[Path]:
    """Write each .mo that is missing or older than its .po; which ones were written."""
    written = []
    for source in sorted(folder.glob("*/LC_MESSAGES/*.po")):
        target = source.with_suffix(".mo")
        if target.exists() and target.stat().st_mtime >= source.stat().st_mtime:
            continue
        with source.open("rb") as file:
            catalogue = read_po(file, locale=source.parts[-3], domain=source.stem)
        partial = target.with_suffix(f".{os.getpid()}.partial")  # others may compile at the same time
        with partial.open("wb") as file:
            write_mo(file, catalogue)
        partial.replace(target)
        written.append(target)
    return written


if __name__ == "__main__":
    compile_catalogues()
