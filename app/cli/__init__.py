"""The `rleex` command. Each group has its own file; heavy imports wait inside the commands."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from app.cli import (
    audit,
    camera,
    can,
    demo,
    doctor,
    emulate,
    evaluate,
    model,
    operator,
    places,
    profile,
    run,
    simulate,
)
from app.errors import AppError
from hal.errors import HardwareError
from kgdfa.errors import KgdfaError
from logs.errors import AuditError
from profiles.errors import ProfileError

cli = typer.Typer(
    name="rleex",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
for part in (run, demo, simulate, doctor, emulate, model, places):
    cli.add_typer(part.cli)
cli.add_typer(audit.cli, name="audit", help="Verify, read, query and report the audit trail.")
cli.add_typer(camera.cli, name="camera", help="List and calibrate cameras.")
cli.add_typer(can.cli, name="can", help="Look at the drives on the bus.")
cli.add_typer(evaluate.cli, name="evaluate", help="Measure what the documents claim.")
cli.add_typer(operator.cli, name="operator", help="Who may use the console.")
cli.add_typer(profile.cli, name="profile", help="Patient profiles.")


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version  # brings a mail parser and zip files along

        typer.echo(f"rleex {version('rleex')}")
        raise typer.Exit


@cli.callback()
def options(
    _: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Tell the version.")] = False,
) -> None:
    """Therapist's console for a gesture-commanded lower-limb exoskeleton."""


USER_ERRORS = (AppError, HardwareError, KgdfaError, AuditError, ProfileError)


def main() -> None:
    """Run the command line; an error a user can cause ends with one sentence and exit status 2."""
    try:
        cli()
    except USER_ERRORS as error:
        sys.stderr.write(f"rleex: {error}\n")
        raise SystemExit(2) from None
