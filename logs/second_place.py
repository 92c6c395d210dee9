"""What the copies of checkpoints in a second place say about the files in the first."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

from logs.copies import SUFFIX
from logs.line import unseal
from logs.scan import Head, head_of


def copied(copy: Path) -> dict[int, str]:
    """Sequence → hash of the copied checkpoints; a line torn by a crash is left out."""
    return {head.sequence: digest for head, digest in _checkpoints(copy)}


def differing(path: Path, expected: Mapping[int, str]) -> int | None:
    """The first record of a file whose hash is not the expected one, by sequence; None when all agree."""
    with path.open("rb") as file:
        for number, line in enumerate(file):
            if number in expected and ((parts := unseal(line)) is None or parts[1] != expected[number]):
                return number
    return None


def copied_files(copies: Path | None, known: Collection[str]) -> list[str]:
    """Files of which the second place holds a checkpoint by a known key; other consoles may use it, too."""
    found = copies.glob("*" + SUFFIX) if copies is not None else ()
    return [
        copy.name.removesuffix(SUFFIX)
        for copy in found
        if any(head.body.key in known for head, _ in _checkpoints(copy))
    ]


def _checkpoints(copy: Path) -> Iterator[tuple[Head, str]]:
    for line in copy.read_bytes().splitlines(keepends=True):
        parts, head = unseal(line), head_of(line)
        if parts is not None and head is not None:
            yield head, parts[1]
