"""Names in the product are the field's words: none of CONTRIBUTING's glossary, left column, and none of its kin."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
PRODUCT = ("app", "hal", "kgdfa", "logs", "profiles")

# Part of a name → what to write. A name is parted at underscores and capitals: `_FirstTold` has first, told.
INSTEAD = {
    "astray": "untrusted",
    "chatter": "stderr",
    "course": "scenario",
    "courses": "scenarios",
    "deaf": "ignore_signal",
    "gather": "collect",
    "glance": "re-detection",
    "glances": "re-detection",
    "graft": "synthetic",
    "grafted": "synthetic",
    "grafter": "synthetic hands",
    "grafts": "synthetic hands",
    "harmless": "sanitized",
    "heard": "received",
    "journey": "attempt",
    "judge": "classify, evaluate",
    "judged": "classified, evaluated",
    "judgement": "verification",
    "ledger": "request tracker",
    "limp": "damped",
    "living": "process",
    "looked": "detected",
    "looking": "detection",
    "mend": "repair",
    "obey": "handle",
    "odd": "unreadable",
    "pace": "period",
    "posture": "pose",
    "said": "message",
    "say": "text",
    "says": "text",
    "seen": "detected",
    "sentence": "text",
    "sentences": "texts",
    "sieve": "filter",
    "spare": "freeze",
    "squash": "normalize",
    "station": "drive",
    "stations": "drives",
    "told": "reported",
    "trial": "attempt",
    "trials": "attempts",
    "way": "distance walked",
    "ways": "cases",
    "weigh": "predict",
    "wish": "request",
    "wishes": "requests",
    "words": "text",
}
# Several parts in a row, or a whole name.
PHRASES = {
    "sign_of_life": "heartbeat",
    "second_place": "mirror",
    "give_way": "ramp_to_damping",
    "giving_way": "ramp_to_damping",
    "carry_on": "advance_action",
    "quiet_garbage": "disable_gc",
    "take_turn": "set_scheduling",
    "under_way": "running",
}
CLASSES = {"Facts", "Memory", "Pace", "Standing", "Task", "Truth", "Turn", "TURNS"}
# Names that stay, and why.
ALLOWED = {"seen_ns": "a field of the STOP record: trails written before must be read"}

_PARTS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+")


@cache
def named_in(path: Path) -> tuple[tuple[int, str], ...]:
    """As `names`, of a file; two tests ask for all files."""
    return tuple(dict.fromkeys(names(path.read_text())))


def names(source: str) -> Iterator[tuple[int, str]]:
    """Every identifier that a source defines or uses, with its line; those inside f-strings too."""
    for node in ast.walk(ast.parse(source)):
        for field in ("id", "attr", "arg", "name", "asname"):
            name = getattr(node, field, None)
            if isinstance(name, str):
                yield getattr(node, "lineno", 0), name


@cache
def fault(name: str) -> str | None:
    """What to write instead; None: the name is fine."""
    if name in ALLOWED:
        return None
    parts = [part.lower() for part in _PARTS.findall(name)]
    joined = f"_{'_'.join(parts)}_"
    found = [INSTEAD[part] for part in parts if part in INSTEAD]
    found += [word for phrase, word in PHRASES.items() if f"_{phrase}_" in joined]
    if name in CLASSES:
        found.append("see the glossary")
    return "; ".join(found) or None


def test_no_name_is_a_term_that_the_glossary_replaces() -> None:
    found = []
    for folder in PRODUCT:
        for path in sorted((ROOT / folder).rglob("*.py")):
            lines = [path.relative_to(ROOT).as_posix()]
            if (word := fault(path.stem)) is not None:
                found.append(f"{lines[0]}: the file's name: {word}")
            found += [f"{lines[0]}:{line} {name}: {word}" for line, name in named_in(path) if (word := fault(name))]
    assert found == []


def test_no_document_names_one_in_code() -> None:
    found = [
        f"{path.relative_to(ROOT)}: `{span}`: {word}"
        for path in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
        for span in re.findall(r"`([A-Za-z_][\w.]*)(?:\(\))?`", path.read_text())
        if path.name != "CONTRIBUTING.md" and (word := next(filter(None, map(fault, span.split("."))), None))
    ]
    assert found == []


def test_every_exception_still_stands_in_the_code() -> None:
    used = {name for folder in PRODUCT for path in (ROOT / folder).rglob("*.py") for _, name in named_in(path)}
    assert set(ALLOWED) - used == set()
