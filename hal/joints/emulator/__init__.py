"""Emulated drives on a bus: firmware with its quirks, a body behind it, faults on demand."""

from hal.joints.emulator.emulator import DriveEmulator, EmulatorThread
from hal.joints.emulator.faults import Fault, ScheduledFault, read_schedule
from hal.joints.emulator.run import run_emulator

__all__ = ["DriveEmulator", "EmulatorThread", "Fault", "ScheduledFault", "read_schedule", "run_emulator"]
