"""rleex operator."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from app.system.operators import OperatorStore, Role
    from app.system.paths import Home
    from logs.records import Body

cli = typer.Typer(no_args_is_help=True)
HomeOption = Annotated[Path | None, typer.Option(help="Data directory.")]
NameArgument = Annotated[str, typer.Argument(help="The operator's name.")]


@cli.command()
def add(
    name: NameArgument,
    role: Annotated[str, typer.Option(help="therapist, engineer or reviewer.")] = "therapist",
    home: HomeOption = None,
) -> None:
    """Add an operator; asks for the PIN. An engineer signs in first, unless there is nobody yet."""
    from app.system.operators import add_operator, load_store
    from app.system.paths import find_home

    place = find_home(home)
    wanted = _role(role)
    store = load_store(place.keys)
    by = ""
    if store.operators:
        store, by = _engineer(place, store)
    changed = add_operator(store, name, wanted, _new_pin(name))
    _keep(place, changed, _change(name, role, "added"), by)
    typer.echo(f"{name.strip()} is added as {role}.")


@cli.command()
def disable(name: NameArgument, home: HomeOption = None) -> None:
    """Keep an operator from signing in; the name stays in the trails. An engineer signs in first."""
    from app.system.operators import disable_operator, load_store
    from app.system.paths import find_home

    place = find_home(home)
    store, by = _engineer(place, load_store(place.keys))
    changed = disable_operator(store, name)
    operator = changed.find(name)
    _keep(place, changed, _change(name, operator.role.value if operator else "", "disabled"), by)
    typer.echo(f"{name.strip()} can't sign in any more.")


@cli.command()
def pin(name: NameArgument, home: HomeOption = None) -> None:
    """Give an operator another PIN (and let a disabled one in again). An engineer signs in first."""
    from app.system.operators import change_pin, load_store
    from app.system.paths import find_home

    place = find_home(home)
    store, by = _engineer(place, load_store(place.keys))
    changed = change_pin(store, name, _new_pin(name))
    operator = changed.find(name)
    _keep(place, changed, _change(name, operator.role.value if operator else "", "PIN changed"), by)
    typer.echo(f"{name.strip()} has another PIN.")


@cli.command("list")
def list_operators(home: HomeOption = None) -> None:
    """Who may use the console, and what each role may do."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from app.system.operators import PERMISSIONS, Permission, Role, load_store
    from app.system.paths import find_home
    from app.text.catalogue import tr
    from logs.sanitize import sanitize_terminal

    console = Console()
    store = load_store(find_home(home).keys)
    people = Table("operator", "role", "", title="Operators")
    for operator in store.operators:
        state = "" if operator.enabled else "disabled"
        people.add_row(Text(sanitize_terminal(operator.name)), operator.role.value, state)
    console.print(people if store.operators else "Nobody yet: `rleex operator add NAME --role engineer`.")
    table = Table("may", *(role.value for role in Role), title="Roles")
    for permission in Permission:
        table.add_row(tr(permission), *("✓" if permission in PERMISSIONS[role] else "–" for role in Role))
    console.print(table)


def _role(text: str) -> Role:
    from app.system.errors import AppError
    from app.system.operators import Role

    try:
        return Role(text)
    except ValueError:
        raise AppError(f"There is no role {text!r}; it is therapist, engineer or reviewer.") from None


def _new_pin(name: str) -> str:
    answer: str = typer.prompt(f"PIN for {name.strip()}", hide_input=True, confirmation_prompt=True)
    return answer


def _engineer(place: Home, store: OperatorStore) -> tuple[OperatorStore, str]:
    """An engineer's sign-in; a refused one is slowed down and recorded."""
    from app.system.errors import AppError
    from app.system.operators import Permission, save_store, sign_in
    from logs.reason import reason
    from logs.records import SignInFailed

    if not store.operators:
        raise AppError("There are no operators yet; `rleex operator add NAME --role engineer` adds the first.")
    name: str = typer.prompt("Engineer")
    attempt = sign_in(store, name, typer.prompt("PIN", hide_input=True), time.time())
    if attempt.operator is None:
        assert attempt.fault is not None
        cause = reason(attempt.fault)
        failed = SignInFailed(name=name, reason=cause, failures=attempt.failures, wait_s=attempt.wait_s)
        save_store(place.keys, attempt.store)
        _tell(place, failed, "")
        raise AppError(attempt.fault, wait_s=attempt.wait_s)
    if not attempt.operator.may(Permission.MANAGE_OPERATORS):
        raise AppError(f"{attempt.operator.name} is no engineer; only engineers manage operators.")
    return attempt.store, attempt.operator.name


def _change(name: str, role: str, change: str) -> Body:
    from logs.records import OperatorChanged

    return OperatorChanged(name=name.strip(), role=role, change=change)


def _keep(place: Home, store: OperatorStore, body: Body, by: str) -> None:
    """The trail first: a change that it doesn't hold is not made."""
    from app.system.operators import save_store

    _tell(place, body, by)
    save_store(place.keys, store)


def _tell(place: Home, body: Body, by: str) -> None:
    from app.system.operators import append_to_journal

    append_to_journal(place, body, by)
