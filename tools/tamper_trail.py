"""Thousands of random tamperings with every trail and journal of a home: `rleex audit verify` must catch each, soon.

`python tools/tamper_trail.py HOME [--number 2000] [--seed 1]`. Works on a copy, as somebody who can write `logs/` but
has neither the console's key nor `keys/`. Exit status 1 when one was missed, or one took longer than `--limit`.
"""

from __future__ import annotations

import random
import re
import shutil
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from logs.keys import by_fingerprint, known_keys, read_anchors
from logs.line import GENESIS, seal, unseal
from logs.verify import Evidence, exit_status, verify

NUMBER = re.compile(rb'(?<=":)\d+(?=[,}])')
WRITTEN = (b"1.0", b"1e300", b"-0", b"0x1", b"9" * 400, b"9" * 5000, b"1e400", b"null", b'"1"')
Files = list[Path]


def flip_bit(files: Files, dice: random.Random) -> None:
    path = dice.choice(files)
    data = bytearray(path.read_bytes())
    data[dice.randrange(len(data))] ^= 1 << dice.randrange(8)
    path.write_bytes(data)


def cut_at_a_line_end(files: Files, dice: random.Random) -> None:
    path, lines = _lines(files, dice)
    path.write_bytes(b"".join(lines[: dice.randrange(len(lines))]))


def remove_the_last_record(files: Files, dice: random.Random) -> None:
    path, lines = _lines(files, dice)
    path.write_bytes(b"".join(lines[: -dice.choice((1, 2))]))


def cut_anywhere(files: Files, dice: random.Random) -> None:
    path = dice.choice(files)
    data = path.read_bytes()
    path.write_bytes(data[: dice.randrange(len(data))])


def remove_a_line(files: Files, dice: random.Random) -> None:
    path, lines = _lines(files, dice)
    del lines[dice.randrange(len(lines))]
    path.write_bytes(b"".join(lines))


def double_a_line(files: Files, dice: random.Random) -> None:
    path, lines = _lines(files, dice)
    lines.insert(dice.randrange(len(lines)), dice.choice(lines))
    path.write_bytes(b"".join(lines))


def reorder(files: Files, dice: random.Random) -> None:
    path, lines = _lines(files, dice)
    one, other = dice.sample(range(len(lines)), 2)
    lines[one], lines[other] = lines[other], lines[one]
    path.write_bytes(b"".join(lines))


def swap_files(files: Files, dice: random.Random) -> None:
    one, other = dice.sample(files, 2)
    first = one.read_bytes()
    one.write_bytes(other.read_bytes())
    other.write_bytes(first)


def move_a_line(files: Files, dice: random.Random) -> None:
    """From one file into another."""
    path, lines = _lines(files, dice)
    _, others = _lines([one for one in files if one != path], dice)
    lines[dice.randrange(len(lines))] = dice.choice(others)
    path.write_bytes(b"".join(lines))


def remove_a_file(files: Files, dice: random.Random) -> None:
    dice.choice(files).unlink()


def append_noise(files: Files, dice: random.Random) -> None:
    with dice.choice(files).open("ab") as file:
        file.write(dice.choice((b"\n", b"{}\n", bytes(100), dice.randbytes(50), b"[" * 50_000)))


def renumber_and_seal(files: Files, dice: random.Random) -> None:
    """The hashes made anew behind it, as far as lines are records; without the key's signature."""
    path = renumber(files, dice)
    out, previous = [], GENESIS
    for line in path.read_bytes().splitlines(keepends=True):
        parts = unseal(line)
        if parts is None:
            out.append(line)
            continue
        payload = re.sub(rb'"previous":"[0-9a-f]{64}"', b'"previous":"%s"' % previous.encode(), parts[0], count=1)
        sealed, previous = seal(payload)
        out.append(sealed)
    path.write_bytes(b"".join(out))


def renumber(files: Files, dice: random.Random) -> Path:
    path, lines = _lines(files, dice)
    places = [(number, found.span()) for number, line in enumerate(lines) for found in NUMBER.finditer(line)]
    number, (start, end) = dice.choice(places)
    line = lines[number]
    written = dice.choice((*WRITTEN, line[start:end] + b".0", b"%d" % (int(line[start:end]) + 1)))
    lines[number] = line[:start] + written + line[end:]
    path.write_bytes(b"".join(lines))
    return path


def _lines(files: Files, dice: random.Random) -> tuple[Path, list[bytes]]:
    path = dice.choice(files)
    return path, path.read_bytes().splitlines(keepends=True)


KINDS: tuple[Callable[[Files, random.Random], object], ...] = (
    flip_bit,
    cut_at_a_line_end,
    remove_the_last_record,
    cut_anywhere,
    remove_a_line,
    double_a_line,
    reorder,
    swap_files,
    move_a_line,
    remove_a_file,
    append_noise,
    renumber,
    renumber_and_seal,
)


def main(
    home: Annotated[Path, typer.Argument(help="A home with sessions and journals that verifies.")],
    number: Annotated[int, typer.Option(help="How many tamperings.")] = 2000,
    seed: Annotated[int, typer.Option(help="Of the dice.")] = 1,
    limit: Annotated[float, typer.Option(help="Seconds of processor time that one verification may take.")] = 2.0,
) -> None:
    """Tamper, verify, restore."""
    dice = random.Random(seed)
    evidence = Evidence(keys=by_fingerprint(known_keys(home / "keys")), anchors=read_anchors(home / "keys"))
    tried, missed, slowest = Counter[str](), Counter[str](), dict.fromkeys((kind.__name__ for kind in KINDS), 0.0)
    with tempfile.TemporaryDirectory(prefix="tampered-") as folder:
        logs = Path(folder) / "logs"
        shutil.copytree(home / "logs", logs)
        whole = {path: path.read_bytes() for path in sorted(logs.glob("*.jsonl"))}
        if exit_status(verify([logs], evidence)) != 0:
            raise SystemExit(f"{home} does not verify as it is")
        for one in range(number):
            kind = KINDS[one % len(KINDS)]
            files = [path for path, data in whole.items() if data]
            kind(files, dice)
            changed = [path for path, data in whole.items() if not path.exists() or path.read_bytes() != data]
            if not changed:  # a record moved to where it was
                continue
            began_s = time.process_time()
            status = exit_status(verify([logs], evidence))
            slowest[kind.__name__] = max(slowest[kind.__name__], time.process_time() - began_s)
            tried[kind.__name__] += 1
            if status == 0:
                missed[kind.__name__] += 1
                Console(stderr=True).print(f"missed: {kind.__name__} in {[path.name for path in changed]}")
            for path in changed:
                path.write_bytes(whole[path])
    table = Table("tampering", "tried", "missed", "slowest verification, ms CPU")
    for kind_name, times in sorted(tried.items()):
        table.add_row(kind_name, str(times), str(missed[kind_name]), f"{slowest[kind_name] * 1e3:.0f}")
    table.add_row("all", str(tried.total()), str(missed.total()), f"{max(slowest.values()) * 1e3:.0f}")
    Console().print(table)
    Console().print(f"{len(whole)} files, {sum(map(len, whole.values()))} bytes")
    raise typer.Exit(1 if missed or max(slowest.values()) > limit else 0)


if __name__ == "__main__":
    typer.run(main)
