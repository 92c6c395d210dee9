"""rleex operator."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from app.cli.common import CliFault, HomeOption, check_finite, check_output, print_text
from app.cli.permission import ask, sign_in
from app.system.enrolment import NEVER_BY_TOKEN, enrol, enrol_first, give_pin, issue_token
from app.system.errors import AppError
from app.system.operators import PERMISSIONS, OperatorFault, Permission, Role, load_store
from app.system.paths import Home, find_home
from app.system.sign_in import is_locked
from app.text.catalogue import tr
from logs.reason import sanitize_terminal

cli = typer.Typer(no_args_is_help=True)
NameArgument = Annotated[str, typer.Argument(help="The operator's name.")]


@cli.command()
def add(
    name: NameArgument,
    role: Annotated[str, typer.Option(help="therapist, engineer or reviewer.")] = "therapist",
    home: HomeOption = None,
) -> None:
    """Add an operator; prompts for the PIN. An engineer signs in first, unless there is none yet."""
    place = find_home(home)
    wanted = _role(role)
    if load_store(place.keys).operators:
        by = sign_in(home, Permission.MANAGE_OPERATORS)
        enrol(by, name, wanted, _new_pin(name))
    elif wanted is not Role.ENGINEER:
        raise AppError(OperatorFault.FIRST_NOT_ENGINEER)
    else:
        enrol_first(place, name, _new_pin(name))
    print_text("cli.operator.added", name=name.strip(), role=wanted)


@cli.command()
def disable(name: NameArgument, home: HomeOption = None) -> None:
    """Keep an operator from signing in; the name stays in the trails. An engineer signs in first."""
    from app.system import enrolment

    enrolment.disable(sign_in(home, Permission.MANAGE_OPERATORS), name)
    print_text("cli.operator.disabled", name=name.strip())


@cli.command()
def pin(name: NameArgument, home: HomeOption = None) -> None:
    """Give an operator another PIN (and let a disabled or locked one in again). An engineer signs in first."""
    give_pin(sign_in(home, Permission.MANAGE_OPERATORS), name, _new_pin(name))
    print_text("cli.operator.pin_changed", name=name.strip())


@cli.command()
def token(
    file: Annotated[Path, typer.Argument(help="Where to; set RLEEX_TOKEN to it.", callback=check_output)],
    may: Annotated[
        list[str] | None,
        typer.Option(
            help="What it may do, as `operator list` names it; may be repeated; a therapist's default: edit patients."
        ),
    ] = None,
    hours: Annotated[float, typer.Option(callback=check_finite, min=0.01, max=720, help="Until it expires.")] = 8.0,
    home: HomeOption = None,
) -> None:
    """Write a token with which a script may act in your name until it expires, or your PIN changes."""
    wanted = frozenset(_permission(one) for one in may or [Permission.EDIT_PATIENTS.value])
    by = ask(find_operators(home))
    if not may and not wanted <= by.permissions:
        known = ", ".join(one.value for one in Permission if one in by.permissions - NEVER_BY_TOKEN)
        raise AppError(CliFault.TOKEN_FOR_WHAT, role=by.role, known=known)
    data = issue_token(by, wanted, hours)
    try:
        with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as written:
            os.fchmod(written.fileno(), 0o600)
            written.write(data)
    except OSError as error:
        raise AppError(CliFault.OUTPUT_UNWRITABLE, path=file, detail=error.strerror) from error
    print_text("cli.operator.token", path=file, hours=hours, name=by.name)


@cli.command("list")
def list_operators(home: HomeOption = None) -> None:
    """List the operators, and what each role may do."""
    console = Console()
    store = load_store(find_home(home).keys)
    people = Table(tr("cli.operator.name"), tr("cli.operator.role"), "", title=tr("cli.operator.operators"))
    for operator in store.operators:
        locked = tr("cli.operator.locked") if is_locked(store, operator) else ""
        state = locked if operator.enabled else tr("OperatorChange.DISABLED")
        people.add_row(Text(sanitize_terminal(operator.name)), tr(operator.role), state)
    console.print(people if store.operators else tr("cli.operator.nobody"))
    table = Table(tr("cli.operator.may"), *(tr(role) for role in Role), title=tr("cli.operator.roles"))
    for permission in Permission:
        table.add_row(
            f"{permission.value}: {tr(permission)}", *("✓" if permission in PERMISSIONS[role] else "–" for role in Role)
        )
    console.print(table)


def _role(text: str) -> Role:
    try:
        return Role(text)
    except ValueError:
        raise AppError(CliFault.NO_SUCH_ROLE, role=text) from None


def _new_pin(name: str) -> str:
    asked, again = tr("cli.operator.pin_for", name=name.strip()), tr("cli.operator.pin_again")
    answer: str = typer.prompt(asked, hide_input=True, confirmation_prompt=again)
    return answer


def _permission(text: str) -> Permission:
    try:
        return Permission(text)
    except ValueError:
        known = ", ".join(one.value for one in Permission)
        raise AppError(CliFault.NO_SUCH_PERMISSION, permission=text, known=known) from None


def find_operators(home: Path | None) -> Home:
    """The home, which must have operators. Raises AppError."""
    place = find_home(home)
    if not load_store(place.keys).operators:
        raise AppError(CliFault.NO_OPERATORS)
    return place
