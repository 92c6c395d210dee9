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

from app.cli import NOT_COMPILED
from app.text import compile as compiling

ROOT = Path(__file__).parents[3]
LIMIT_S = 30.0
ANOTHER = """
import pathlib, sys
from app.text.compile import compile_catalogues
compile_catalogues(pathlib.Path(sys.argv[1]))
"""
UNCOMPILED = """
import pathlib, sys
from app.text import catalogue
catalogue.LOCALES = pathlib.Path(sys.argv.pop(1))
from app.cli import main
main()
"""


@pytest.mark.parametrize("arguments", [("locate",), ("--help",), ("--language", "zh", "locate"), ("run", "--nothing")])
def test_an_uncompiled_program_says_how_to_compile_it(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    for language in ("en", "zh"):
        (tmp_path / language / "LC_MESSAGES").mkdir(parents=True)
    command = [sys.executable, "-c", UNCOMPILED, str(tmp_path), *arguments]
    done = subprocess.run(command, capture_output=True, cwd=ROOT, text=True, timeout=LIMIT_S, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"rleex: {NOT_COMPILED}\n"


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
