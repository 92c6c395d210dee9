"""Where a RealSense's frame sets come from: librealsense's pipeline, or the sensors of one device.

A software device can't be found by a pipeline since librealsense 2.55 (its issue 13819); its sensors are opened one by
one and meet in the syncer.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any, Protocol


class Streams(Protocol):
    """A started source of frame sets. device: librealsense's; profiles: of its running streams."""

    device: Any
    profiles: list[Any]

    def wait(self, timeout_ms: int) -> Any | None:
        """The next frame set, None when none came in time. Raises RuntimeError, librealsense's, when lost."""

    def stop(self) -> None:
        """End it. Raises RuntimeError, librealsense's, when it had not started."""


class PipelineStreams:
    """A camera or a recording, as the configuration names it."""

    def __init__(self, rs: ModuleType, config: Any, context: Any) -> None:
        """Start it; RuntimeError when librealsense can't."""
        self._pipeline = rs.pipeline(context) if context is not None else rs.pipeline()
        profile = self._pipeline.start(config)
        self.device = profile.get_device()
        self.profiles = list(profile.get_streams())

    def wait(self, timeout_ms: int) -> Any | None:
        there, frames = self._pipeline.try_wait_for_frames(timeout_ms)
        return frames if there else None

    def stop(self) -> None:
        self._pipeline.stop()


class SensorStreams:
    """All streams of one device, opened sensor by sensor."""

    def __init__(self, rs: ModuleType, device: Any) -> None:
        """Start them; RuntimeError when librealsense can't."""
        self.device = device
        self.profiles = []
        self._syncer = rs.syncer()
        self._sensors = list(device.query_sensors())
        for sensor in self._sensors:
            profiles = sensor.get_stream_profiles()
            sensor.open(profiles)
            sensor.start(self._syncer)
            self.profiles.extend(profiles)

    def wait(self, timeout_ms: int) -> Any | None:
        """The next frame set in time; the first may lack a stream, which counts as none."""
        there, frames = self._syncer.try_wait_for_frames(timeout_ms)
        return frames if there and frames.size() == len(self.profiles) else None

    def stop(self) -> None:
        for sensor in self._sensors:
            sensor.stop()
            sensor.close()
