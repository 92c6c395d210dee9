"""Catalogues are compiled to what gettext reads, also by several processes at once."""

from __future__ import annotations

import gettext
import subprocess
import sys
from pathlib import Path
from typing import BinaryIO

import pytest
from babel.messages import Catalog
from babel.messages.mofile import write_mo

from app.text import compile as compiling

ROOT = Path(__file__).parents[3]
LIMIT_S = 30.0
ANOTHER = """
import pathlib, sys
from app.text.compile import compile_catalogues
compile_catalogues(pathlib.Path(sys.argv[1]))
"""


def test_another_process_may_compile_the_same_catalogue_meanwhile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "en" / "LC_MESSAGES"
    folder.mkdir(parents=True)
    (folder / "x.po").write_text('msgid "key"\nmsgstr "text"\n', encoding="utf-8")

    def write_later(file: BinaryIO, catalogue: Catalog) -> None:
        subprocess.run([sys.executable, "-c", ANOTHER, str(tmp_path)], check=True, cwd=ROOT, timeout=LIMIT_S)
        write_mo(file, catalogue)

    monkeypatch.setattr(compiling, "write_mo", write_later)
    assert compiling.compile_catalogues(tmp_path) == [folder / "x.mo"]
    assert sorted(path.name for path in folder.iterdir()) == ["x.mo", "x.po"]
    with (folder / "x.mo").open("rb") as file:
        assert gettext.GNUTranslations(file).gettext("key") == "text"
