"""Every code that the product raises or records, and every key that it asks for, is worded in both languages."""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from app.text.compile import LOCALES
from tests.support.catalogues import entries

ROOT = Path(__file__).parents[3]
PRODUCT = ("app", "hal", "kgdfa", "logs", "profiles")
TAKE_A_CODE = ("reason", "tr")  # functions whose first argument is an Enum's member, as that of each error
TAKE_A_KEY = ("tr", "print_text", "t")


@cache
def wanted() -> frozenset[str]:
    """`ClassName.MEMBER` of each code, and each key, that the source names in a call."""
    paths = (path for room in PRODUCT for path in (ROOT / room).rglob("*.py"))
    return frozenset(key for path in paths for key in _in_file(ast.parse(path.read_text(encoding="utf-8"))))


def _in_file(tree: ast.Module) -> Iterator[str]:
    nodes = list(ast.walk(tree))
    named = dict(_other_names(nodes))
    for node in nodes:
        if isinstance(node, ast.Call) and node.args and isinstance(node.func, ast.Name):
            yield from _in_call(node.func.id, node.args[0], named)


def _other_names(nodes: list[ast.AST]) -> Iterator[tuple[str, str]]:
    """Short names of classes: `import Class as C`, `C = Class`, `C, D = Class, Other`."""
    for node in nodes:
        if isinstance(node, ast.ImportFrom):
            yield from ((name.asname, name.name) for name in node.names if name.asname)
        if isinstance(node, ast.Assign):
            targets, values = _parts(node.targets[0]), _parts(node.value)
            pairs = zip(targets, values, strict=False)
            yield from ((a.id, b.id) for a, b in pairs if isinstance(a, ast.Name) and isinstance(b, ast.Name))


def _parts(node: ast.expr) -> list[ast.expr]:
    return node.elts if isinstance(node, ast.Tuple) else [node]


def _in_call(function: str, first: ast.expr, named: dict[str, str]) -> Iterator[str]:
    if function in TAKE_A_KEY and isinstance(first, ast.Constant) and isinstance(first.value, str):
        yield first.value
    takes_a_code = function in TAKE_A_CODE or function.endswith("Error")
    if takes_a_code and isinstance(first, ast.Attribute) and isinstance(first.value, ast.Name) and first.attr.isupper():
        if first.value.id == "errno":
            return
        yield f"{named.get(first.value.id, first.value.id)}.{first.attr}"


@pytest.mark.parametrize("language", ["en", "zh"])
def test_every_code_and_key_is_worded(language: str) -> None:
    assert len(wanted()) > 300
    assert sorted(wanted() - entries(language).keys()) == []


@pytest.mark.parametrize("language", ["en", "zh"])
def test_no_key_is_worded_twice(language: str) -> None:
    """Of two wordings the reader keeps one without a word: a column was headed as another table's."""
    files = sorted((LOCALES / language / "LC_MESSAGES").glob("*.po"))
    keys = Counter(
        key for file in files for key in re.findall(r'^msgid "(.+)"$', file.read_text("utf-8"), re.MULTILINE)
    )
    assert [key for key, count in keys.items() if count > 1] == []
