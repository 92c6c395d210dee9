"""The catalogues' sources as tables, for tests that ask what is worded."""

from __future__ import annotations

from babel.messages.pofile import read_po

from app.text.compile import LOCALES


def entries(language: str) -> dict[str, tuple[str, ...]]:
    """Every key of a language with its text, one for each plural form."""
    found: dict[str, tuple[str, ...]] = {}
    for source in sorted((LOCALES / language / "LC_MESSAGES").glob("*.po")):
        with source.open("rb") as file:
            for message in read_po(file, locale=language, domain=source.stem):
                key = message.id if isinstance(message.id, str) else message.id[0]
                if key:
                    found[key] = (message.string,) if isinstance(message.string, str) else tuple(message.string or ())
    return found
