"""A third language is one file: what it says is said, what it lacks is English, and F3 reaches it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from app.text import catalogue
from app.text.catalogue import knows, languages, tr, use_language
from app.text.compile import compile_catalogues
from tests.app.console.conftest import Opener

GERMAN = """
msgid ""
msgstr ""
"Content-Type: text/plain; charset=utf-8\\n"
"Plural-Forms: nplurals=2; plural=(n != 1);\\n"

msgid "language.name"
msgstr "Deutsch"

msgid "bind.help"
msgstr "Hilfe"

msgid "guide.confirm"
msgstr "{confirm} bestätigt die Person."
"""


def forget() -> None:
    """What was read of the catalogues."""
    for cached in (catalogue.load, catalogue.languages, catalogue._message):
        cached.cache_clear()


@pytest.fixture
def german(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """One more folder with one file in it."""
    locales = tmp_path / "locales"
    shutil.copytree(catalogue.LOCALES, locales)
    folder = locales / "de" / "LC_MESSAGES"
    folder.mkdir(parents=True)
    (folder / "console.po").write_text(GERMAN, encoding="utf-8")
    compile_catalogues(locales)
    monkeypatch.setattr(catalogue, "LOCALES", locales)
    forget()
    yield
    monkeypatch.undo()
    forget()
    use_language("en")


@pytest.mark.usefixtures("german")
def test_what_it_lacks_is_english() -> None:
    use_language("en")
    english, steps = tr("stop.idle"), tr("details.did", count=1, distance_m=2.0, minutes=3.0)
    use_language("de")
    assert languages() == {"de": "Deutsch", "en": "English", "zh": "中文"}
    assert tr("bind.help") == "Hilfe"
    assert tr("stop.idle") == english
    assert tr("details.did", count=1, distance_m=2.0, minutes=3.0) == steps
    assert knows("stop.idle")
    assert not knows("no.such.key")


@pytest.mark.usefixtures("german")
async def test_its_key_reaches_it(console: Opener) -> None:
    async with console() as opened:
        await opened.press("f3", "f3")  # en, zh, and around to de
        await opened.shows("c bestätigt die Person.")
        await opened.shows("■ STOP ■  press SPACE")
