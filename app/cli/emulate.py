"""rleex emulate-drives."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.live import Live

from app.cli.common import check_finite
from app.cli.permission import sign_in
from app.system.operators import Permission
from app.system.paths import find_home
from app.text.catalogue import tr
from hal.joints.device import DEFAULT_DEVICE, Exoskeleton, load_exoskeleton
from profiles.schema import DEMO_PATIENT
from profiles.store import ProfileStore

if TYPE_CHECKING:
    from hal.joints.body import Body
    from hal.joints.emulator.emulator import DriveEmulator

cli = typer.Typer()


@cli.command("emulate-drives")
def emulate_drives(
    interface: Annotated[str, typer.Option(help="socketcan, local, or any of python-can's.")] = "",
    channel: Annotated[str, typer.Option(help="e.g. vcan0, or 43113 for local.")] = "",
    device: Annotated[Path | None, typer.Option(help="Device description; default: the built-in one.")] = None,
    motors: Annotated[Path | None, typer.Option(help="A TOML that extends the motor table.")] = None,
    patient: Annotated[str, typer.Option(help="Hang this patient's simulated body on the drives.")] = "",
    fault: Annotated[
        list[str] | None, typer.Option(help="[joint:]fault[=value][@seconds], e.g. left_knee:silent@10.")
    ] = None,
    seconds: Annotated[float, typer.Option(callback=check_finite, help="End after this long; 0: never.", min=0)] = 0.0,
    home: Annotated[Path | None, typer.Option(help="Data directory (for --patient).")] = None,
) -> None:
    """Emulate the four drives of the exoskeleton on a CAN bus."""
    from hal.joints.can.bus import with_bus
    from hal.joints.emulator.emulator import run_emulator
    from hal.joints.emulator.firmware import read_schedule

    sign_in(home, Permission.CONFIGURE)
    described = with_bus(load_exoskeleton(device or DEFAULT_DEVICE), interface, channel)
    schedule = tuple(read_schedule(text) for text in fault or ())
    body = _body(patient, home) if patient else None
    _run_shown(described, partial(run_emulator, described, body=body, motors=motors, schedule=schedule), seconds)


def _run_shown(described: Exoskeleton, run: Callable[..., None], seconds: float) -> None:
    """Show what the drives do, each second, until they end."""
    from app.cli.drive_table import emulated_drives_table

    console = Console()
    buses = ", ".join(f"{bus.channel} ({bus.interface})" for bus in described.buses)
    console.print(tr("emulate.running", device=described.name, buses=buses))
    end_s = time.monotonic() + seconds if seconds else float("inf")
    with Live(console=console, auto_refresh=False, transient=True) as live:

        def poll(emulator: DriveEmulator) -> None:
            live.update(emulated_drives_table(emulator), refresh=True)
            if time.monotonic() >= end_s:
                raise KeyboardInterrupt

        try:
            run(each_second=poll)
        except KeyboardInterrupt:
            console.print(tr("emulate.ended"))


def _body(patient: str, home: Path | None) -> Body:
    from app.motion.plan import body_of

    if patient == DEMO_PATIENT.identifier:
        return body_of(DEMO_PATIENT)
    return body_of(ProfileStore(find_home(home).profiles).load(patient))
