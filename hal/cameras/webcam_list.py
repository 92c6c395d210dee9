"""The webcams of this machine as the kernel lists them, found by name or number without opening one."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from hal.errors import CameraFault, HardwareError

SYSFS = Path("/sys/class/video4linux")


@dataclass(frozen=True, slots=True, kw_only=True)
class WebcamEntry:
    """One video device as the kernel lists it."""

    index: int
    name: str


def list_webcams(sysfs: Path = SYSFS) -> tuple[WebcamEntry, ...]:
    """The video devices of this machine, by index. A camera may list more than one; its images are on the first."""
    found = []
    for entry in sysfs.glob("video*"):
        number = re.fullmatch(r"video(\d+)", entry.name)
        if number is None:
            continue
        with suppress(OSError):  # unplugged meanwhile
            name = (entry / "name").read_text(errors="replace").strip()
            found.append(WebcamEntry(index=int(number[1]), name=name))
    return tuple(sorted(found, key=lambda entry: entry.index))


def find_webcam(device: str, entries: tuple[WebcamEntry, ...]) -> WebcamEntry:
    """By index, or by a part of its name; "" is the first. Raises HardwareError listing what there is."""
    wanted = device.strip().lower()
    for entry in entries:
        if wanted in ("", str(entry.index), f"/dev/video{entry.index}") or (
            not wanted.isdigit() and wanted in entry.name.lower()
        ):
            return entry
    if not entries:
        raise HardwareError(CameraFault.NO_WEBCAM)
    known = ", ".join(f"{entry.index} ({entry.name})" for entry in entries)
    raise HardwareError(CameraFault.WEBCAM_NOT_FOUND, device=device, known=known)


def same_webcam(first: str, second: str) -> bool:
    """Whether two names are one webcam's; where one of them is not there, whether they are the same name."""
    entries = list_webcams()
    try:
        return find_webcam(first, entries) == find_webcam(second, entries)
    except HardwareError:
        return first == second
