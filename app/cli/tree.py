"""The commands as a tree. Each group has its own file; heavy imports wait inside the commands.

The library takes a fifth of a second to build the whole tree of commands, so only the branch that was asked for is
built: a therapist who types `rleex run` does not wait for the twenty others.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Annotated

import typer

# command → its file
_COMMANDS = {
    "run": "run",
    "demo": "demo",
    "simulate": "simulate",
    "doctor": "doctor",
    "emulate-drives": "emulate",
    "model": "model",
    "locate": "places",
}
# group → its help; the file has the group's name
_GROUPS = {
    "audit": "Verify, read, query and report the audit trail.",
    "camera": "List and calibrate cameras.",
    "can": "Look at the drives on the bus.",
    "evaluate": "Measure what the documents claim.",
    "operator": "Who may use the console.",
    "profile": "Patient profiles.",
}


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version  # brings a mail parser and zip files along

        typer.echo(f"rleex {version('rleex')}")
        raise typer.Exit


def options(
    _: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Tell the version.")] = False,
) -> None:
    """Therapist's console for a gesture-commanded lower-limb exoskeleton."""


def tree(words: Sequence[str] = ()) -> typer.Typer:
    """The commands as a tree: the one branch that the words name, or all of it."""
    asked = {words[0]} if words and words[0] in {*_COMMANDS, *_GROUPS} else {*_COMMANDS, *_GROUPS}
    built = typer.Typer(name="rleex", no_args_is_help=True, pretty_exceptions_enable=False)
    built.callback()(options)
    for name, file in _COMMANDS.items():
        if name in asked:
            built.add_typer(_part(file))
    for name, about in _GROUPS.items():
        if name in asked:
            built.add_typer(_part(name), name=name, help=about)
    return built


def _part(file: str) -> typer.Typer:
    part = import_module(f"app.cli.{file}").cli
    assert isinstance(part, typer.Typer)
    return part
