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
    str,
    typer.Option(
        help="socketcan, local, or any of python-can's; default: the configuration's, with --device the file's."
    ),
]
Channel = Annotated[
    str,
    typer.Option(
        help="e.g. can0; 43113 for local; a,b for two buses; default: the configuration's, with --device the file's."
    ),
]
Device = Annotated[
    Path | None, typer.Option(help="Device description; default: the configuration's, else the built-in one.")
]
Motors = Annotated[Path | None, typer.Option(help="A TOML that extends the motor table; default: the configuration's.")]


def described_drives(
    home: Path | None, device: Path | None, interface: str, channel: str, motors: Path | None = None
) -> tuple[Exoskeleton, Path | None]:
    """The device on its buses, and what extends the motor table; not given: as `[joints]` names it, of either kind.

    A device that is given has its own buses: by those of another one, joints would be reached that are not meant.
    A first power-on is done before `kind` is "can". Raises AppError, HardwareError for a file that can't be used.
    """
    from hal.joints.can.bus import with_bus  # brings python-can

    joints = load_config(find_home(home).config).joints
    named = joints if device is None else replace(joints, device=str(device), interface="", channel="")
    described = with_bus(load_device(named), interface or named.interface, channel or named.channel)
    return described, motors or (Path(joints.motors) if joints.motors else None)
