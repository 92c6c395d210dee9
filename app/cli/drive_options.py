"""Options of the commands that reach drives: what none names is as a session of this home has it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from msgspec.structs import replace

from app.system.config import load_config, load_device
from app.system.paths import find_home
from hal.joints.device import Exoskeleton

Interface = Annotated[
    str, typer.Option(help="socketcan, local, or any of python-can's; default: the configuration's, else the device's.")
]
Channel = Annotated[
    str, typer.Option(help="e.g. can0, vcan0, or 43113 for local; default: the configuration's, else the device's.")
]
Device = Annotated[
    Path | None, typer.Option(help="Device description; default: the configuration's, else the built-in one.")
]
Motors = Annotated[Path | None, typer.Option(help="A TOML that extends the motor table; default: the configuration's.")]


def described_drives(
    home: Path | None, device: Path | None, interface: str, channel: str, motors: Path | None = None
) -> tuple[Exoskeleton, Path | None]:
    """The device on its buses, and what extends the motor table; not given: as `[joints]` names it, of either kind.

    A first power-on is done before `kind` is "can". Raises AppError, HardwareError for a file that can't be used.
    """
    from hal.joints.can.bus import with_bus  # brings python-can

    joints = load_config(find_home(home).config).joints
    named = joints if device is None else replace(joints, device=str(device))
    described = with_bus(load_device(named), interface or joints.interface, channel or joints.channel)
    return described, motors or (Path(joints.motors) if joints.motors else None)
