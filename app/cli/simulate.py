"""rleex simulate, emulate-drives, press-input: simulated actions, drives emulated on a bus, simulated stop buttons."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer
from rich.console import Console
from rich.live import Live

from app.cli.common import (
    CliFault,
    HomeOption,
    Json,
    bar,
    check_figure,
    check_finite,
    check_output,
    refuse_options,
    shown_after,
    wide_console,
)
from app.cli.drive_options import Channel, Device, Interface, Motors, described_drives
from app.cli.permission import sign_in
from app.ipc.states import Action
from app.system.config import load_config, load_device
from app.system.errors import AppError
from app.system.operators import Permission
from app.system.paths import Home, find_home
from app.text.catalogue import tr
from hal.joints.device import Exoskeleton
from profiles.schema import Profile
from profiles.store import ProfileStore

if TYPE_CHECKING:
    from app.evaluate.loop.rehearsal import Norm
    from app.motion.plan import Patient
    from app.motion.rehearsal import Rehearsal
    from app.motion.rehearsal_checks import RehearsalVerdict
    from hal.joints.body import Body
    from hal.joints.emulator.emulator import DriveEmulator

cli = typer.Typer()


@cli.command()
def simulate(
    action: Annotated[
        str, typer.Argument(help="An action's name (walk, stair-up, ...), `all`, `corners`, or `dropout`.")
    ],
    profile: Annotated[str, typer.Option("--profile", "-p", help="Patient: identifier or path of a TOML.")] = "demo",
    gait: Annotated[Path | None, typer.Option(help="Folder of normative gait curves, for `walk`.")] = None,
    plot_file: Annotated[
        Path | None, typer.Option("--plot", callback=check_figure, help="Write angles, torques and paths as PNG.")
    ] = None,
    video: Annotated[Path | None, typer.Option(callback=check_output, help="Write a stick-figure film, MP4.")] = None,
    json_file: Json = None,
    preflight: Annotated[
        bool,
        typer.Option(help="Keep the verdicts as this patient's pre-flight; a therapist or engineer signs in first."),
    ] = False,
    home: HomeOption = None,
) -> None:
    """Simulate an action through planner, follower and guard; exit status 1 when it does not pass."""
    from app.evaluate.harness import write_json
    from app.evaluate.loop.rehearsal import profile_named, read_norm, verdict_table

    if action in {"corners", "dropout"}:
        unused = {"--gait": gait, "--video": video, "--preflight": preflight}
        if action == "corners":  # it has patients of its own
            unused |= {"--plot": plot_file, "--profile": profile != "demo"}
        refuse_options(action, unused)
    place = find_home(home)
    config = load_config(place.config)
    if preflight:
        if config.joints.host:
            raise AppError(CliFault.PREFLIGHT_ELSEWHERE, host=config.joints.host)
        sign_in(home, Permission.OPERATE)
    console = wide_console()
    device = load_device(config.joints)
    if action == "dropout":
        _drop_out(console, profile_named(place, profile), device, json_file, plot_file)
        return
    norm = read_norm(gait) if gait is not None else None
    correlations: list[str] = []
    if action == "corners":
        rows = _at_the_corners(console, device)
    else:
        wearer = profile_named(place, profile)
        wanted = _Wanted(
            norm=norm,
            plot_file=plot_file,
            video=video,
            preflight=place if preflight else None,
            correlations=correlations,
        )
        rows = [(wearer, verdict) for verdict in _rehearsed(console, wearer, device, action, wanted)]
    with shown_after([*correlations, verdict_table(rows)]):
        write_json([{"patient": who.identifier, **msgspec.to_builtins(verdict)} for who, verdict in rows], json_file)
    if not all(verdict.passed for _, verdict in rows):
        raise typer.Exit(1)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Wanted:
    """What is made of a rehearsal beside its verdict."""

    norm: Norm | None
    plot_file: Path | None
    video: Path | None
    preflight: Home | None  # where the verdict is kept
    correlations: list[str]  # with the norm, a line an action

    def keep(self, shown: Rehearsal, patient: Patient, device: Exoskeleton, *, many: bool) -> None:
        """Pre-flight, plot, film and correlation with the norm, as far as they are wanted."""
        from app.evaluate.loop.rehearsal import correlation, film, plot
        from app.motion.preflight import keep_verdict

        action = shown.verdict.action
        if self.preflight is not None:
            keep_verdict(self.preflight, patient, device, action, shown.verdict)
        if self.plot_file is not None:
            plot(shown, named(self.plot_file, action.name, many=many), self.norm)
        if self.video is not None:
            film(shown, patient.body, named(self.video, action.name, many=many))
        if self.norm is not None and len(shown.starts) > 4:
            values = correlation(shown, self.norm)
            self.correlations.append(tr("evaluate.rehearsal.correlation", action=action, **values))


def _at_the_corners(console: Console, device: Exoskeleton) -> list[tuple[Profile, RehearsalVerdict]]:
    from app.evaluate.loop.rehearsal import corner_profiles, corners

    with bar(console, tr("evaluate.progress.corners"), len(list(corner_profiles())) * len(Action)) as step:
        return corners(device, step)


def _drop_out(
    console: Console, wearer: Profile, device: Exoskeleton, json_file: Path | None, plot_file: Path | None
) -> None:
    """Commands missing for some time at each action's fastest moment; exit status 1 when the guard refuses one."""
    from app.evaluate.harness import write_json
    from app.evaluate.loop.dropout import MISSING_MS, all_dropouts, dropout_table, plot_dropouts
    from app.motion.plan import patient_of

    with bar(console, wearer.identifier, len(Action) * len(MISSING_MS)) as step:
        found = all_dropouts(patient_of(wearer, device), device, step)
    with shown_after([dropout_table(found)]):
        write_json([msgspec.to_builtins(one) for one in found], json_file)
        if plot_file is not None:
            plot_dropouts(found, plot_file)
    if any(one.guard_refusal is not None for one in found):
        raise typer.Exit(1)


def _rehearsed(
    console: Console, wearer: Profile, device: Exoskeleton, action: str, wanted: _Wanted
) -> Iterator[RehearsalVerdict]:
    """The verdicts of one patient's actions, one after the other."""
    from app.evaluate.loop.rehearsal import actions_named
    from app.motion.plan import patient_of
    from app.motion.rehearsal import rehearse

    patient = patient_of(wearer, device)
    actions = actions_named(action)
    with bar(console, wearer.identifier, len(actions)) as step:
        for one in actions:
            shown = rehearse(patient, device, one)
            wanted.keep(shown, patient, device, many=len(actions) > 1)
            step()
            yield shown.verdict


def named(file: Path, action: str, *, many: bool) -> Path:
    """The file for one action of several."""
    return file.with_stem(f"{file.stem}-{action.lower().replace('_', '-')}") if many else file


@cli.command("emulate-drives")
def emulate_drives(
    interface: Interface = "",
    channel: Channel = "",
    device: Device = None,
    motors: Motors = None,
    patient: Annotated[str, typer.Option(help="Hang this patient's simulated body on the drives.")] = "",
    fault: Annotated[
        list[str] | None, typer.Option(help="[joint:]fault[=value][@seconds], e.g. left_knee:silent@10.")
    ] = None,
    seconds: Annotated[float, typer.Option(callback=check_finite, help="End after this long; 0: never.", min=0)] = 0.0,
    home: HomeOption = None,
) -> None:
    """Emulate the four drives of the exoskeleton on a CAN bus; it refuses a real bus on which anybody sends.

    An engineer signs in first.
    """
    from hal.joints.emulator.emulator import run_emulator
    from hal.joints.emulator.faults import read_schedule

    sign_in(home, Permission.CONFIGURE)
    described, table = described_drives(home, device, interface, channel, motors)
    schedule = tuple(read_schedule(text) for text in fault or ())
    body = _body(patient, home) if patient else None
    _check_free(described)
    _run_shown(described, partial(run_emulator, described, body=body, motors=table, schedule=schedule), seconds)


def _check_free(device: Exoskeleton) -> None:
    """Beside real drives, each joint would be answered for twice. Raises HardwareError."""
    from hal.joints.can.bus import open_bus
    from hal.joints.can.scan import listen
    from hal.joints.emulator.scenes import is_virtual

    for bus in device.buses:
        if not is_virtual(bus):
            with open_bus(bus) as opened:
                listen(opened).check_free(bus.channel)


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

    return body_of(ProfileStore(find_home(home).profiles).load(patient))


class Pressing(Enum):
    """What to do with a simulated stop button."""

    TAP = "tap"
    PRESS = "press"
    RELEASE = "release"
    UNPLUG = "unplug"
    BOUNCE = "bounce"


@cli.command()
def press_input(
    name: Annotated[str, typer.Argument(help="Its name in [[inputs]] of config.toml.")],
    how: Annotated[Pressing, typer.Argument(help="tap: press and let go; press: and hold; release also plugs in.")] = (
        Pressing.TAP
    ),
    home: HomeOption = None,
) -> None:
    """Press a simulated stop button of the running session."""
    from app.session.shared import shared
    from hal.errors import HardwareError, StopInputFault
    from hal.inputs.device import Contact
    from hal.inputs.simulated import set_simulated

    down, up = (Contact.OPEN, 0.3), (Contact.CLOSED, 0.0)
    moments = {
        Pressing.TAP: [down, up],
        Pressing.PRESS: [(Contact.OPEN, 0.0)],
        Pressing.RELEASE: [up],
        Pressing.UNPLUG: [(Contact.SILENT, 0.0)],
        Pressing.BOUNCE: [*[(Contact.OPEN, 0.003), (Contact.CLOSED, 0.003)] * 5, down, up],
    }
    setup = shared(find_home(home))
    known = [one.name for one in setup.config.inputs if one.kind == "simulated"]
    if name not in known:
        raise HardwareError(StopInputFault.NOT_SIMULATED, name=name, known=", ".join(known) or "–")
    for contact, seconds in moments[how]:
        set_simulated(setup.links.path, name, contact)
        time.sleep(seconds)
