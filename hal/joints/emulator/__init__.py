"""Emulated drives on a bus: firmware with its quirks, a simulated body behind it, faults on demand."""
