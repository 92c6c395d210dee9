"""rleex joints: the exoskeleton's own computer, headless, for a therapist's laptop that is paired with it."""

from __future__ import annotations

from typing import Annotated

import typer

from app.cli.common import HomeOption, print_text

cli = typer.Typer()
PORT = 7447  # app.link.wire.PORT, without its imports


@cli.command()
def joints(
    home: HomeOption = None,
    port: Annotated[int, typer.Option(min=1, max=65535, help="TCP and UDP port.")] = PORT,
    print_service: Annotated[
        bool, typer.Option("--print-service", help="Print a systemd service file for this command and end.")
    ] = False,
    verbose: Annotated[bool, typer.Option("--verbose", help="Log more for engineers.")] = False,
) -> None:
    """Run on the exoskeleton's computer: control, guardian, planner and drives for a paired laptop's console."""
    from app.system.config import load_config
    from app.system.paths import find_home, hold_home

    place = find_home(home)
    if print_service:
        from app.link.service import service_file

        typer.echo(service_file(place, port), nl=False)
        return
    from app.link.server import serve_joints
    from app.system.diagnostics_log import set_verbose, start_log

    if verbose:
        set_verbose()
    config = load_config(place.config)
    with hold_home(place):
        start_log(place, "joints")
        serve_joints(place, config, port, lambda _: print_text("cli.joints.ready", port=port, home=place.root))
