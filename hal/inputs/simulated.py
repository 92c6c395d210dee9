"""A button of the simulation: a file of the session that another terminal changes (`rleex press-input`)."""

from __future__ import annotations

from pathlib import Path

from hal.errors import HardwareError, StopInputFault
from hal.inputs.device import Contact, ContactReading, InputDevice

_CLOSED = b"closed"


def simulated_path(folder: Path, name: str) -> Path:
    """Where a simulated input of this name is; folder: the session's own."""
    return folder / f"input-{name}"


def set_simulated(folder: Path, name: str, contact: Contact) -> None:
    """Press it, let it go, or pull its plug. Raises HardwareError where the session has none of this name."""
    path = simulated_path(folder, name)
    try:
        if contact is Contact.SILENT:
            path.unlink(missing_ok=True)
        else:
            path.write_bytes(_CLOSED if contact is Contact.CLOSED else b"open")
    except OSError as error:
        raise HardwareError(StopInputFault.UNPLUGGED, name=name) from error


class SimulatedInput:
    """Closed while its file says so."""

    def __init__(self, device: InputDevice, folder: Path) -> None:
        self._name = device.name
        self._folder = folder
        self._path = simulated_path(folder, device.name)
        self._begun = False

    def open(self, now_ns: int) -> None:  # noqa: ARG002
        """Plugged in and not pressed at the beginning; opened again, it stays as it is."""
        if not self._begun:
            set_simulated(self._folder, self._name, Contact.CLOSED)
        self._begun = True

    def read(self, now_ns: int) -> ContactReading:  # noqa: ARG002
        """As the file is now."""
        try:
            closed = self._path.read_bytes() == _CLOSED
        except OSError:
            return ContactReading(Contact.SILENT, HardwareError(StopInputFault.UNPLUGGED, name=self._name))
        return ContactReading(Contact.CLOSED if closed else Contact.OPEN)

    def close(self) -> None:
        """The session's folder goes with the session."""
