"""rleex can: scan, monitor, doctor, decode, record, zero."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from app.cli.common import HomeOption, check_bus_log, check_finite
from app.cli.drive_options import Channel, Device, Interface, Motors, described_drives
from app.cli.drive_table import decoded_line, monitor_table, summary_table
from app.cli.permission import sign_in
from app.diagnostics.findings import show
from app.system.authority import Subject
from app.system.legs_lock import claim_buses
from app.system.operators import Permission
from app.system.paths import find_home
from app.text.catalogue import render, tr
from hal.errors import CanFault, DeviceFault, HardwareError
from hal.joints.can.bus import open_bus
from hal.joints.can.candump import LogDecoder, LogSummary, messages_of, open_log
from hal.joints.can.recorder import BusRecorder
from hal.joints.can.scan import BusMonitor, listen
from hal.joints.can.scan import scan as scan_bus
from hal.joints.device import JOINT_NAMES, Exoskeleton, Joint
from logs.disk import FLOOR_BYTES
from logs.reason import reason_of, sanitize_terminal

cli = typer.Typer(no_args_is_help=True)

Seconds = Annotated[float, typer.Option(callback=check_finite, help="End after this long; 0: by Ctrl-C.", min=0)]


def _joint(name: str) -> Joint:
    """The joint with this name. Raises HardwareError."""
    wanted = name.strip().upper().replace(" ", "_")
    if wanted not in Joint.__members__:
        raise HardwareError(DeviceFault.UNKNOWN_JOINT, name=name, known=", ".join(JOINT_NAMES))
    return Joint[wanted]


@contextmanager
def _alone(home: Path | None, device: Exoskeleton) -> Iterator[None]:
    """Nobody else has the drives: no session, and nobody who sends. Raises AppError, HardwareError."""
    with closing(claim_buses(find_home(home), device)):
        for bus in device.buses:
            with open_bus(bus) as opened:
                listen(opened).check_still(bus.channel)
        yield


@cli.command()
def scan(
    interface: Interface = "",
    channel: Channel = "",
    device: Device = None,
    force: Annotated[bool, typer.Option(help="Ask although others send: disables enabled drives.")] = False,
    home: HomeOption = None,
) -> None:
    """List the drives that reply, with their protocol. It disables enabled drives, so it refuses a bus in use.

    An engineer signs in first.
    """
    sign_in(home, Permission.CONFIGURE)
    console = Console()
    columns = ("bus", "id", "protocol", "answers", "detail")
    table = Table(*(tr(f"drives.{column}") for column in columns), box=None)
    described, _ = described_drives(home, device, interface, channel)
    for bus in described.buses:
        with open_bus(bus) as opened, console.status(tr("can.listening", bus=bus.channel)) as status:
            traffic = listen(opened)
            if not force:
                traffic.check_still(bus.channel)

            def show(protocol: str, drive_id: int) -> None:
                status.update(tr("can.asking", protocol=protocol, can_id=drive_id))

            for drive in scan_bus(opened, uploads=traffic.uploads, watch=show):
                several = tr("can.several", drives=drive.answers) if drive.answers > 1 else "1"
                detail = tr(drive.code, **drive.values)
                table.add_row(bus.channel, str(drive.drive_id), drive.protocol, several, detail)
    console.print(table if table.row_count else tr("can.no_answer"), soft_wrap=True)
    raise typer.Exit(0 if table.row_count else 1)


@cli.command()
def monitor(
    interface: Interface = "",
    channel: Channel = "",
    device: Device = None,
    motors: Motors = None,
    seconds: Seconds = 0.0,
    ask: Annotated[
        bool,
        typer.Option(
            "--ask", help="Ask the drives where they are: disables enabled drives. An engineer signs in first."
        ),
    ] = False,
    home: HomeOption = None,
) -> None:
    """Show a live table of the drives' reports and commands; sends nothing without --ask."""
    console = Console()
    described, table = described_drives(home, device, interface, channel, motors)
    with ExitStack() as stack:
        if ask:
            sign_in(home, Permission.CONFIGURE)
            stack.enter_context(_alone(home, described))
        watched = stack.enter_context(closing(BusMonitor(described, table, ask=ask)))
        end_s = time.monotonic() + seconds if seconds else float("inf")
        try:
            with Live(console=console, auto_refresh=False) as live:
                while time.monotonic() < end_s:
                    watched.poll(0.2)
                    live.update(monitor_table(watched), refresh=True)
        except KeyboardInterrupt:
            pass


@cli.command()
def doctor(
    interface: Interface = "",
    channel: Channel = "",
    device: Device = None,
    motors: Motors = None,
    listen: Annotated[bool, typer.Option("--listen", help="Only listen, ask nothing.")] = False,
    home: HomeOption = None,
) -> None:
    """Check the bus and its drives, with a remedy for each finding; exit status 0 if there is no fault.

    An engineer signs in first, unless it only listens.
    """
    from app.diagnostics.can_doctor import examine

    if not listen:
        sign_in(home, Permission.CONFIGURE)
    console = Console()
    described, table = described_drives(home, device, interface, channel, motors)
    with console.status(tr("can.examining")):
        well = show(console, examine(described, table, ask=not listen))
    raise typer.Exit(0 if well else 1)


@cli.command()
def decode(
    file: Annotated[Path, typer.Argument(help="A candump log, also .gz, also cut in half.")],
    channel: Channel = "",
    device: Device = None,
    motors: Motors = None,
    joint: Annotated[str, typer.Option(help="Only this joint, e.g. left_knee.")] = "",
    summary: Annotated[bool, typer.Option("--summary", help="Only the summary.")] = False,
    home: HomeOption = None,
) -> None:
    """Decode a recorded bus into joint values, frame by frame, with a summary of gaps and faults."""
    decoder = LogDecoder(*described_drives(home, device, "", channel, motors))
    wanted = _joint(joint) if joint else None
    totals = LogSummary()
    with open_log(file) as log:
        for message in messages_of(log, totals):
            decoded = decoder.decode(message)
            totals.add(decoded)
            if not summary and (wanted is None or decoded.joint is wanted):
                sys.stdout.write(f"{decoded_line(decoded)}\n")
    if not totals.counts:
        raise HardwareError(CanFault.LOG_WITHOUT_FRAMES, path=file)
    Console(stderr=not summary).print(summary_table(totals), soft_wrap=True)


@cli.command()
def record(
    file: Annotated[Path, typer.Argument(callback=check_bus_log, help="Where to; candump's format, appended.")],
    interface: Interface = "",
    channel: Channel = "",
    device: Device = None,
    seconds: Seconds = 0.0,
    home: HomeOption = None,
) -> None:
    """Record everything on the bus as candump would. A session on CAN does this by itself, beside its audit log."""
    console = Console()
    described, _ = described_drives(home, device, interface, channel)

    def report(gap: HardwareError) -> None:
        console.print(sanitize_terminal(render(reason_of(gap))), soft_wrap=True, markup=False)

    recorder = BusRecorder(described, file, floor_bytes=FLOOR_BYTES, report=report)
    end_s = time.monotonic() + seconds if seconds else float("inf")
    try:
        with console.status(Text(sanitize_terminal(tr("can.recording", path=file)))):
            recorder.run(lambda: time.monotonic() >= end_s)
    except KeyboardInterrupt:
        pass
    finally:
        recorder.close()
    line = tr("can.recorded", frames=recorder.frames, path=file)
    console.print(sanitize_terminal(line), soft_wrap=True, markup=False)


@cli.command()
def zero(
    joint: Annotated[str, typer.Argument(help="left_hip, left_knee, right_hip or right_knee.")],
    interface: Interface = "",
    channel: Channel = "",
    device: Device = None,
    motors: Motors = None,
    home: HomeOption = None,
) -> None:
    """Set a joint's zero at its present pose. You confirm twice; the joint must be still and disabled.

    An engineer signs in first.
    """
    from hal.joints.can.driver import SocketCanJoints
    from hal.joints.can.zero import request_zero, set_zero

    by = sign_in(home, Permission.CONFIGURE)
    wanted = _joint(joint)
    described, table = described_drives(home, device, interface, channel, motors)
    joints = SocketCanJoints(described, motors=table)
    with _alone(home, described):
        joints.open(time.monotonic_ns())
        try:
            typer.confirm(tr("can.zero_pose", joint=wanted), abort=True)
            request = request_zero(joints, wanted)
            question = tr("can.zero_confirm", angle_rad=request.angle_rad, code=request.code)
            values = {"zero_rad": (0.0, request.angle_rad)}
            permit = partial(by.change, Permission.CONFIGURE, Subject.JOINT, wanted.name.lower(), values)
            angle_rad = set_zero(joints, request, typer.prompt(question), permit)
            typer.echo(tr("can.zero_done", angle_rad=angle_rad))
            if joints.drives[wanted].codec.traits.loses_zero:
                typer.echo(tr("can.zero_temporary"))
        finally:
            joints.close(time.monotonic_ns())
