"""rleex operator."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.common import CliFault, HomeOption, print_text

if TYPE_CHECKING:
    from app.system.operators import OperatorStore, Role
    from app.system.paths import Home
    from logs.records import Body

cli = typer.Typer(no_args_is_help=True)
NameArgument = Annotated[str, typer.Argument(help="The operator's name.")]


@cli.command()
def add(
    name: NameArgument,
    role: Annotated[str, typer.Option(help="therapist, engineer or reviewer.")] = "therapist",
    home: HomeOption = None,
) -> None:
    """Add an operator; prompts for the PIN. An engineer signs in first, unless there is none yet."""
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
    print_text("cli.operator.added", name=name.strip(), role=wanted)


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
    print_text("cli.operator.disabled", name=name.strip())


@cli.command()
def pin(name: NameArgument, home: HomeOption = None) -> None:
    """Give an operator another PIN (and let a disabled one in again). An engineer signs in first."""
    from app.system.operators import change_pin, load_store
    from app.system.paths import find_home

    place = find_home(home)
    store, by = _engineer(place, load_store(place.keys))
    changed = change_pin(store, name, _new_pin(name))
    operator = changed.find(name)
    _keep(place, changed, _change(name, operator.role.value if operator else "", "pin_changed"), by)
    print_text("cli.operator.pin_changed", name=name.strip())


@cli.command("list")
def list_operators(home: HomeOption = None) -> None:
    """List the operators, and what each role may do."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from app.system.operators import PERMISSIONS, Permission, Role, load_store
    from app.system.paths import find_home
    from app.text.catalogue import tr
    from logs.sanitize import sanitize_terminal

    console = Console()
    store = load_store(find_home(home).keys)
    people = Table(tr("cli.operator.name"), tr("cli.operator.role"), "", title=tr("cli.operator.operators"))
    for operator in store.operators:
        state = "" if operator.enabled else tr("OperatorChange.DISABLED")
        people.add_row(Text(sanitize_terminal(operator.name)), tr(operator.role), state)
    console.print(people if store.operators else tr("cli.operator.nobody"))
    table = Table(tr("cli.operator.may"), *(tr(role) for role in Role), title=tr("cli.operator.roles"))
    for permission in Permission:
        table.add_row(tr(permission), *("✓" if permission in PERMISSIONS[role] else "–" for role in Role))
    console.print(table)


def _role(text: str) -> Role:
    from app.system.errors import AppError
    from app.system.operators import Role

    try:
        return Role(text)
    except ValueError:
        raise AppError(CliFault.NO_SUCH_ROLE, role=text) from None


def _new_pin(name: str) -> str:
    from app.text.catalogue import tr

    asked, again = tr("cli.operator.pin_for", name=name.strip()), tr("cli.operator.pin_again")
    answer: str = typer.prompt(asked, hide_input=True, confirmation_prompt=again)
    return answer


def _engineer(place: Home, store: OperatorStore) -> tuple[OperatorStore, str]:
    """An engineer's sign-in; a refused one is slowed down and recorded."""
    from app.system.errors import AppError
    from app.system.operators import Permission, append_to_journal, save_store, sign_in
    from app.text.catalogue import tr
    from logs.reason import reason
    from logs.records import SignInFailed

    if not store.operators:
        raise AppError(CliFault.NO_OPERATORS)
    name: str = typer.prompt(tr("Role.ENGINEER"))
    attempt = sign_in(store, name, typer.prompt("PIN", hide_input=True), time.time())
    if attempt.operator is None:
        assert attempt.fault is not None
        cause = reason(attempt.fault)
        failed = SignInFailed(name=name, reason=cause, failures=attempt.failures, wait_s=attempt.wait_s)
        save_store(place.keys, attempt.store)
        append_to_journal(place, failed, "")
        raise AppError(attempt.fault, wait_s=attempt.wait_s)
    if not attempt.operator.may(Permission.MANAGE_OPERATORS):
        raise AppError(CliFault.NOT_AN_ENGINEER, name=attempt.operator.name)
    return attempt.store, attempt.operator.name


def _change(name: str, role: str, change: str) -> Body:
    from logs.records import OperatorChanged

    return OperatorChanged(name=name.strip(), role=role, change=change)


def _keep(place: Home, store: OperatorStore, body: Body, by: str) -> None:
    """The trail first: a change that is not recorded is not made."""
    from app.system.operators import append_to_journal, save_store

    append_to_journal(place, body, by)
    save_store(place.keys, store)
