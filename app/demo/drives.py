"""Which joints the demo commands: simulated ones, or emulated drives on a CAN bus in a process of their own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from app.system.config import Config, JointsConfig
from app.system.errors import AppError


@contextmanager
def joints_for(kind: str, base: Config) -> Iterator[JointsConfig]:
    """The joints' configuration; for `can` the drives are emulated while the body runs."""
    if kind == "simulated":
        yield JointsConfig(kind="simulated", device=base.joints.device)
        return
    if kind != "can":
        raise AppError(f"--joints {kind}: there are only `simulated` and `can`.")
    from app.demo.emulation import emulated_drives

    with emulated_drives(base.joints) as joints:
        yield joints
