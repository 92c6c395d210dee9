"""rleex can: scan, monitor, doctor, decode, record, zero."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from hal.joints.device import Exoskeleton

cli = typer.Typer(no_args_is_help=True)

Interface = Annotated[str, typer.Option(help="python-can's interface; default: the device description's.")]
Channel = Annotated[str, typer.Option(help="e.g. can0, vcan0, or 43113 for local.")]
Device = Annotated[Path | None, typer.Option(help="Device description; default: the built-in one.")]
Motors = Annotated[Path | None, typer.Option(help="A TOML that extends the motor table.")]


def _device(device: Path | None, interface: str, channel: str) -> Exoskeleton:
    from hal.joints.can.bus import with_bus
    from hal.joints.device import DEFAULT_DEVICE, load_exoskeleton

    return with_bus(load_exoskeleton(device or DEFAULT_DEVICE), interface, channel)


@cli.command()
def scan(
    interface: Interface = "",
    channel: Channel = "",
    device: Device = None,
    force: Annotated[bool, typer.Option(help="Ask although others talk: lets go of enabled drives.")] = False,
) -> None:
    """Who answers in which protocol. Lets go of drives that are enabled, so it refuses on a bus in use."""
    from rich.console import Console
    from rich.table import Table

    from hal.errors import HardwareError
    from hal.joints.can.bus import open_bus
    from hal.joints.can.scan import listen
    from hal.joints.can.scan import scan as scan_bus

    console = Console()
    table = Table("bus", "ID", "protocol", "answers", "detail", box=None)
    for bus in _device(device, interface, channel).buses:
        with open_bus(bus) as opened, console.status(f"Listening on {bus.channel} …") as status:
            heard = listen(opened)
            if heard.busy and not force:
                raise HardwareError(
                    f"{heard.frames} frames on {bus.channel} without being asked: another program commands these "
                    f"drives; end it first (or --force, with nobody in the device)."
                )
            for drive in scan_bus(opened, watch=lambda what: status.update(f"Asking: {what}")):
                several = f"{drive.answers} drives!" if drive.answers > 1 else "1"
                table.add_row(bus.channel, str(drive.drive_id), drive.protocol, several, drive.detail)
    console.print(table if table.row_count else "Nobody answers: run `rleex can doctor`.", soft_wrap=True)
    raise typer.Exit(0 if table.row_count else 1)


@cli.command()
def monitor(
    interface: Interface = "",
    channel: Channel = "",
    device: Device = None,
    motors: Motors = None,
    seconds: Annotated[float, typer.Option(help="End after this long; 0: by Ctrl-C.", min=0)] = 0.0,
) -> None:
    """A live table of what the drives report and what they are told; sends nothing."""
    import time

    from rich.console import Console
    from rich.live import Live

    from app.cli.drive_table import monitor_table
    from hal.joints.can.scan import BusMonitor

    console = Console()
    watched = BusMonitor(_device(device, interface, channel), motors)
    end_s = time.monotonic() + seconds if seconds else float("inf")
    try:
        with Live(console=console, auto_refresh=False) as live:
            while time.monotonic() < end_s:
                watched.look(0.2)
                live.update(monitor_table(watched), refresh=True)
    except KeyboardInterrupt:
        pass
    finally:
        watched.close()


@cli.command()
def doctor(
    interface: Interface = "",
    channel: Channel = "",
    device: Device = None,
    motors: Motors = None,
    listen: Annotated[bool, typer.Option("--listen", help="Ask nobody, only listen.")] = False,
) -> None:
    """Why the bus or a drive is silent, and what mends it; ends 0 when all is well."""
    from rich.console import Console

    from app.diagnostics.can_doctor import examine
    from app.diagnostics.findings import show

    console = Console()
    with console.status("Examining the buses …"):
        well = show(console, examine(_device(device, interface, channel), motors, ask=not listen))
    raise typer.Exit(0 if well else 1)


@cli.command()
def decode(
    file: Annotated[Path, typer.Argument(help="A candump log, also .gz, also cut in half.")],
    device: Device = None,
    motors: Motors = None,
    joint: Annotated[str, typer.Option(help="Only this joint, e.g. left_knee.")] = "",
    summary: Annotated[bool, typer.Option("--summary", help="Only the summary.")] = False,
) -> None:
    """What a recorded bus said, in the joints' words, with a summary of gaps and faults."""
    import sys

    from rich.console import Console

    from app.cli.drive_table import summary_table
    from hal.joints.can.candump import Decoder, LogSummary, messages_of, open_log
    from hal.joints.can.scan import stations_of

    decoder = Decoder(stations_of(_device(device, "", ""), motors))
    wanted = joint.lower().replace("_", " ")
    gathered = LogSummary()
    with open_log(file) as log:
        for message in messages_of(log, gathered):
            decoded = decoder.decode(message)
            gathered.add(decoded)
            if not summary and (not wanted or decoded.drive == wanted):
                sys.stdout.write(f"{decoded.at_s:.6f}  {decoded.drive:<10}  {decoded.kind:<8}  {decoded.text}\n")
    Console(stderr=not summary).print(summary_table(gathered), soft_wrap=True)


@cli.command()
def record(
    file: Annotated[Path, typer.Argument(help="Where to; candump's format, appended.")],
    interface: Interface = "",
    channel: Channel = "",
    device: Device = None,
    seconds: Annotated[float, typer.Option(help="End after this long; 0: by Ctrl-C.", min=0)] = 0.0,
) -> None:
    """Record everything on the bus as candump would. A session on CAN does this by itself, beside its audit log."""
    import time

    from rich.console import Console

    from hal.joints.can.candump import BusRecorder

    console = Console()
    recorder = BusRecorder(_device(device, interface, channel), file)
    end_s = time.monotonic() + seconds if seconds else float("inf")
    try:
        with console.status(f"Recording to {file}; Ctrl-C ends it."):
            recorder.run(lambda: time.monotonic() >= end_s)
    except KeyboardInterrupt:
        pass
    finally:
        recorder.close()
    console.print(f"{recorder.frames} frames in {file}.", soft_wrap=True)


@cli.command()
def zero(
    joint: Annotated[str, typer.Argument(help="left_hip, left_knee, right_hip or right_knee.")],
    interface: Interface = "",
    channel: Channel = "",
    device: Device = None,
    motors: Motors = None,
) -> None:
    """Make a joint's present pose its zero. Asks for your word twice; the joint has to be still and off."""
    import math
    import time

    from hal.errors import HardwareError
    from hal.joints.can.driver import SocketCanJoints
    from hal.joints.can.lifecycle import ask_zero, set_zero
    from hal.joints.protocol import Joint

    if joint.upper() not in Joint.__members__:
        raise HardwareError(f"There is no joint {joint}: use left_hip, left_knee, right_hip or right_knee.")
    joints = SocketCanJoints(_device(device, interface, channel), motors=motors)
    joints.open(time.monotonic_ns())
    try:
        typer.confirm(f"Is the {joint.replace('_', ' ')} at its zero pose, unloaded, and held still?", abort=True)
        request = ask_zero(joints, Joint[joint.upper()])
        shown = f"It stands at {math.degrees(request.angle_rad):.1f}°. To make this its zero, type {request.word}"
        angle_rad = set_zero(joints, request, typer.prompt(shown))
        typer.echo(f"Done: the drive now says {math.degrees(angle_rad):.2f}°.")
    finally:
        joints.close(time.monotonic_ns())
