"""What import-linter can't see: tests and tools are no packages of the product."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FORBIDDEN = {"tests": {"tools"}, "tools": {"tests"}, "testing": {"tests", "tools"}} | {
    room: {"tests", "tools", "testing"} for room in ("app", "hal", "kgdfa", "logs", "profiles")
}


def imported(file: Path) -> Iterator[str]:
    """The top packages that a file imports."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (one.name.partition(".")[0] for one in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.partition(".")[0]


@pytest.mark.parametrize("room", FORBIDDEN)
def test_tests_and_tools_do_not_know_each_other_and_the_product_knows_neither(room: str) -> None:
    wrong = [(file, found) for file in (ROOT / room).rglob("*.py") for found in {*imported(file)} & FORBIDDEN[room]]
    assert not wrong
