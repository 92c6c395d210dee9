"""Buttons that stop, from tick to tick: values only."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from app.ipc.streams import NS_PER_MS
from hal.errors import HardwareError
from hal.inputs.device import Contact, InputReading, InputReadings, InputRole
from logs import records
from logs.reason import reason_of

# A press may be unseen since the last reading: beyond this age the legs pause, with a tick within 25 ms.
READER_LATE_NS = 20 * NS_PER_MS
READER_SILENT_NS = 200 * NS_PER_MS  # not the host any more, which lets threads wait for 100 ms: the reader has ended
CLOSED_NS = 50 * NS_PER_MS  # closed for so long without a gap: contacts bounce for 1 to 20 ms


class StopInputState(Struct, frozen=True, kw_only=True):
    """One button. It stops while `open`."""

    name: str
    role: InputRole
    contact: Contact
    open: bool = True
    pressing: bool = False  # it was closed, and opens now
    pressed_once: bool = False  # and let go: known to work in this session
    opened_ns: int = 0  # when it was last read as not closed
    fault: HardwareError | None = None


StopInputStates = tuple[StopInputState, ...]


def update_stop_inputs(before: StopInputStates, readings: InputReadings, now_ns: int, age_ns: int) -> StopInputStates:
    """The buttons after a tick; age_ns: as of `reader_age_ns`."""
    silent = age_ns > READER_SILENT_NS
    known: dict[str, StopInputState] = {one.name: one for one in before}
    return tuple(_updated(known.get(one.name), one, now_ns, silent=silent) for one in readings.inputs)


def reader_age_ns(readings: InputReadings, now_ns: int, delay_ns: int) -> int:
    """How long ago the inputs were read, less delay_ns, in which control did not run either; 0 without inputs."""
    return now_ns - readings.at_ns - delay_ns if readings.inputs else 0


def input_records(before: StopInputStates, after: StopInputStates, at_ns: int) -> Iterator[records.Body]:
    """What opened or closed, for the trail."""
    was = {one.name: one.open for one in before}
    for one in after:
        if one.open is not was.get(one.name):
            why = None if one.fault is None else reason_of(one.fault)
            yield records.StopInput(
                name=one.name, role=one.role.value, contact=one.contact.value, at_ns=at_ns, reason=why
            )


def _updated(before: StopInputState | None, now: InputReading, now_ns: int, *, silent: bool) -> StopInputState:
    contact = Contact.SILENT if silent else now.contact
    is_open = contact is not Contact.CLOSED
    if before is not None:  # a press between two ticks counts, however late the second one is
        is_open = is_open or now.opened_ns > before.opened_ns or (before.open and now_ns - now.opened_ns < CLOSED_NS)
    pressing = before is not None and (before.pressing or (contact is Contact.OPEN and not before.open))
    return StopInputState(
        name=now.name,
        role=now.role,
        contact=contact,
        open=is_open,
        pressing=pressing and is_open and contact is not Contact.SILENT,
        pressed_once=before is not None and (before.pressed_once or (before.pressing and not is_open)),
        opened_ns=now.opened_ns,
        fault=now.fault,
    )
