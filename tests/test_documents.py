"""The documents: every relative link leads to a file, and every file named in the map of the code is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CATALOGUES = tuple(sorted((ROOT / "app" / "text" / "locales").rglob("*.po")))
DOCUMENTS = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md")))
_TABLE_RULE = re.compile(r"\|[-:| ]+\|")
_LINK = re.compile(r"\]\(([^)#:]+)(?:#[^)]*)?\)")
_FOLDERS = "app|hal|kgdfa|logs|profiles|testing|tests|tools|docs"
_FILE = re.compile(rf"`((?:{_FOLDERS})/[\w./-]*(?:\.(?:py|toml|po|md|svg)|/))`")


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_relative_link_leads_somewhere(document: Path) -> None:
    links = _LINK.findall(document.read_text(encoding="utf-8"))
    assert [link for link in links if not (document.parent / link).exists()] == []


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_file_of_ours_that_is_named_exists(document: Path) -> None:
    named = _FILE.findall(document.read_text(encoding="utf-8"))
    assert [name for name in named if "*" not in name and not (ROOT / name).exists()] == []


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_table_has_a_heading(document: Path) -> None:
    """A blank line within one makes text of the rows below it."""
    text = re.sub(r"^```.*?^```", "", document.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    tables = re.findall(r"(?:^\|.*\n)+", text, flags=re.MULTILINE)
    assert [table for table in tables if not _TABLE_RULE.fullmatch(([*table.splitlines(), ""])[1])] == []


def test_a_pre_flight_is_never_asked_for_without_the_patient() -> None:
    """Left out, it is the demo patient's: who types what stands there must not pass the wrong one."""
    command = re.compile(r"^.*rleex simulate .*--preflight.*$", re.MULTILINE)
    found = [line for path in (*DOCUMENTS, *CATALOGUES) for line in command.findall(path.read_text(encoding="utf-8"))]
    assert len(found) >= 4
    assert [line for line in found if not re.search(r"simulate all (-p|--profile) \S+ --preflight", line)] == []
