"""The commands as a tree. Each group has its own file; heavy imports wait inside the commands.

Only the requested branch is built: a therapist who types `rleex run` does not wait for the twenty others, and the
overview of the groups imports none of them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Annotated

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup, TyperOption

# command → its file
_COMMANDS = {
    "run": "run",
    "demo": "run",
    "joints": "run",
    "simulate": "simulate",
    "doctor": "machine",
    "emulate-drives": "simulate",
    "press-input": "simulate",
    "export": "sessions",
    "replay": "sessions",
    "query": "sessions",
    "outcomes": "sessions",
    "model": "machine",
    "locate": "machine",
    "configure": "machine",
}
# group → its help; the file has the group's name
_GROUPS = {
    "audit": "Verify, read, query and report the audit trail.",
    "camera": "List and calibrate cameras.",
    "can": "Drives on the bus.",
    "evaluate": "Measure what the documents claim.",
    "link": "Pair the therapist's laptop with the exoskeleton's computer.",
    "operator": "Operators and what they may do.",
    "profile": "Patient profiles.",
    "recording": "What a session's recording holds.",
}
_MARKUP = re.compile(r"\[(?=[a-z#/@])")  # what Rich would take for a style, and leave out


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version  # brings a mail parser and zip files along

        typer.echo(f"rleex {version('rleex')}")
        raise typer.Exit


def options(
    _version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
    language: Annotated[
        str, typer.Option(help="en or zh, before or after the command; else the configuration's.")
    ] = "",
) -> None:
    """Therapist's console for a gesture-commanded lower-limb exoskeleton."""
    if language:
        from app.text.catalogue import ask_language

        ask_language(language)


def command(arguments: Sequence[str] | None = None) -> TyperCommand | TyperGroup:
    """What the first argument names, an overview, or everything, with its help in the language in use."""
    from app.text.catalogue import language, load

    built = typer.main.get_command(tree(arguments))
    assert isinstance(built, TyperCommand | TyperGroup)
    translate: Callable[[str], str] = load(language()).gettext if language() != "en" else str  # the keys are English
    _set_help(built, lambda text: _MARKUP.sub(r"\\[", translate(text)))
    return built


def _set_help(command: TyperCommand | TyperGroup, text: Callable[[str], str]) -> None:
    from app.text.catalogue import tr

    command.help = text(command.help) if command.help else None
    shown = [*command.params, command.get_help_option(typer.Context(command))]  # typer makes --help, in English
    for parameter in shown:
        if isinstance(parameter, TyperArgument | TyperOption):
            parameter.help = text(parameter.help) if parameter.help else None
            parameter.rich_help_panel = tr("cli.options" if isinstance(parameter, TyperOption) else "cli.arguments")
    if isinstance(command, TyperGroup):
        for part in command.commands.values():
            assert isinstance(part, TyperCommand | TyperGroup)
            part.rich_help_panel = tr("cli.commands")
            _set_help(part, text)


def tree(arguments: Sequence[str] | None = None) -> typer.Typer:
    """The one branch that the first argument names; without it all of them, or groups that are empty yet."""
    known = {*_COMMANDS, *_GROUPS}
    asked = {arguments[0]} & known if arguments else set()
    built = typer.Typer(name="rleex", no_args_is_help=True, pretty_exceptions_enable=False)
    built.callback()(options)
    for file in dict.fromkeys(file for name, file in _COMMANDS.items() if not asked or name in asked):
        built.add_typer(_part(file))
    for name, about in _GROUPS.items():
        if not asked or name in asked:
            built.add_typer(_part(name) if asked or arguments is None else typer.Typer(), name=name, help=about)
    return built


def _part(file: str) -> typer.Typer:
    part = import_module(f"app.cli.{file}").cli
    assert isinstance(part, typer.Typer)
    return part
