"""Which drive a received frame comes from, and what it means when it comes from none."""

from __future__ import annotations

from collections import Counter

from hal.joints.can.drive import Station
from hal.joints.codecs import damiao
from hal.joints.codecs.wire import NEUTRAL, Codec, Frame
from hal.joints.motors import WireProtocol
from hal.joints.protocol import BusFault

_FINE = (BusFault.NONE, "")


class Routes:
    """The stations of one bus by everything that can name them in a frame."""

    def __init__(self, stations: list[Station]) -> None:
        self._commands: dict[tuple[int, bool], Station] = {}
        self._registers: tuple[Station, dict[int, float]] | None = None
        self._by_reply_id: dict[int, Station] = {}
        self._by_drive: dict[WireProtocol, tuple[Codec, dict[int, Station]]] = {}
        shared = Counter(station.device.reply_id for station in stations)
        for station in stations:
            protocol, drive_id = station.model.protocol, station.device.can_id
            self._by_drive.setdefault(protocol, (station.codec, {}))[1][station.told_as] = station
            commanding = station.codec.command(drive_id, NEUTRAL)
            self._commands[(commanding.arbitration_id, commanding.extended)] = station
            # a Damiao drive with a master ID of its own is told by it: data[0] has only four bits of the ID
            if protocol is WireProtocol.DAMIAO and station.device.reply_id and shared[station.device.reply_id] == 1:
                self._by_reply_id[station.device.reply_id] = station

    def deliver(self, frame: Frame, measured_ns: int) -> tuple[BusFault, str]:
        """Hand a frame to its station; what is wrong with it otherwise, with a sentence."""
        if self._registers is not None and self._take_register(frame, *self._registers):
            return _FINE
        commanded = self._commands.get((frame.arbitration_id, frame.extended))
        if commanded is not None and commanded.is_echo(frame.data):
            return _FINE
        station = self._sender(frame)
        if station is None or self._only_seems_to_be(station, commanded, frame):
            return self._stray(frame, commanded)
        return _take_in(station, frame, measured_ns)

    def await_registers(self, station: Station, told: dict[int, float] | None) -> None:
        """From now on, register replies of this station go into `told`; None ends that."""
        self._registers = None if told is None else (station, told)

    def _take_register(self, frame: Frame, station: Station, told: dict[int, float]) -> bool:
        value = damiao.register_reply(frame)
        if value is None or value.drive_id != station.device.can_id:
            return False
        told[value.register] = value.value
        return True

    def _sender(self, frame: Frame) -> Station | None:
        if not frame.extended and frame.arbitration_id in self._by_reply_id:
            return self._by_reply_id[frame.arbitration_id]
        for codec, by_drive in self._by_drive.values():
            drive_id = codec.replier(frame)
            if drive_id is not None and drive_id in by_drive:
                return by_drive[drive_id]
        return None

    def _only_seems_to_be(self, station: Station, commanded: Station | None, frame: Frame) -> bool:
        """On a drive's command ID only that drive may answer, unless the host has the same ID (drive 0, host 0)."""
        return commanded not in (None, station) and frame.arbitration_id != station.device.reply_id

    def _stray(self, frame: Frame, commanded: Station | None) -> tuple[BusFault, str]:
        if self._is_own_echo(frame):
            return _FINE
        if commanded is not None:
            return BusFault.DUPLICATE_ID, f"another program commands {commanded.name}: end it"
        return (
            BusFault.UNKNOWN_ID,
            f"a frame of nobody described: ID {frame.arbitration_id:X}, {frame.data.hex(' ')}",
        )

    def _is_own_echo(self, frame: Frame) -> bool:
        return any(
            station.is_echo(frame.data) for _, by_drive in self._by_drive.values() for station in by_drive.values()
        )


def _take_in(station: Station, frame: Frame, measured_ns: int) -> tuple[BusFault, str]:
    reply = station.codec.read_reply(frame)
    if reply is None:
        return BusFault.MALFORMED, f"a reply of {len(frame.data)} bytes from {station.name} makes no sense"
    if not station.take(reply, measured_ns):
        text = "answers more often than asked: two drives share its ID, or another program commands it"
        return BusFault.DUPLICATE_ID, f"{station.name} {text}"
    return _FINE
