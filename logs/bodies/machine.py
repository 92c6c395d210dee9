"""How the machine does: drives, joints by the second, punctuality, heartbeats, clocks, losses."""

from __future__ import annotations

from msgspec import Struct

from logs.bodies.values import Quad


class Drives(Struct, frozen=True, kw_only=True, tag_field="kind", tag="drives"):
    """The drives' life cycle as the driver confirmed it."""

    state: str
    detail: str = ""


class JointStatistics(Struct, frozen=True, kw_only=True, tag_field="kind", tag="joints"):
    """A second of the four joints."""

    period_s: float
    angle_min_rad: Quad
    angle_mean_rad: Quad
    angle_max_rad: Quad
    target_mean_rad: Quad
    torque_min_nm: Quad
    torque_mean_nm: Quad
    torque_max_nm: Quad
    temperature_c: Quad
    tracking_rms_rad: Quad = (None, None, None, None)
    state: str = ""


class TickLateness(Struct, frozen=True, kw_only=True, tag_field="kind", tag="lateness"):
    """How late control's ticks began, since the session's start."""

    ticks: int
    missed: int
    p50_ms: float
    p99_ms: float
    p999_ms: float
    max_ms: float


class RealTimePrivilege(Struct, frozen=True, kw_only=True, tag_field="kind", tag="real-time"):
    """Which real-time privileges control got."""

    fifo: bool
    memory_locked: bool
    core: int | None = None
    cores_awake: bool = False


class HeartbeatLost(Struct, frozen=True, kw_only=True, tag_field="kind", tag="heartbeat-lost"):
    """A stream's sign of life is overdue."""

    stream: str
    age_ms: float


class HeartbeatFound(Struct, frozen=True, kw_only=True, tag_field="kind", tag="heartbeat-found"):
    """A stream's sign of life is back."""

    stream: str
    silent_ms: float


class ClockStep(Struct, frozen=True, kw_only=True, tag_field="kind", tag="clock-step"):
    """The wall clock was moved against the monotonic one."""

    step_s: float


class RecordsLost(Struct, frozen=True, kw_only=True, tag_field="kind", tag="records-lost"):
    """Records that a full queue or a malformed message kept from the trail: their number is known, at least."""

    count: int
    reason: str
