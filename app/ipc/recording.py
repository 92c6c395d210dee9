"""What control and perception hand to the recording process; numbers travel as bytes of arrays, in batches."""

from __future__ import annotations

from msgspec import Struct

from app.ipc.messages import OperatorCommand, TriggerReport
from app.ipc.snapshot import ControlSnapshot

BATCH_TICKS = 25  # 50 ms: the period of control's snapshot, which goes with each batch
QUANTITIES = (  # of a tick's values, in this order; (4,) each, in the order of hal.joints.protocol.Joint
    "position_rad",
    "velocity_rad_s",
    "torque_nm",
    "target_rad",
    "target_rad_s",
    "feedforward_nm",
    "stiffness_nm_rad",
    "damping_nm_s_rad",
)


class Contact(Struct, frozen=True, kw_only=True):
    """Vertical force on each foot; simulated joints only, drives measure none."""

    at_ns: int
    left_n: float
    right_n: float


class LinkAges(Struct, frozen=True, kw_only=True):
    """How old control's newest message of each stream is."""

    report_ms: float
    console_ms: float
    audit_ms: float
    guardian_ms: float
    audit_waiting: int = 0  # records that are not on the disk yet


class TickBatch(Struct, frozen=True, kw_only=True, tag="ticks"):
    """Control, some ticks in a row: at_ns int64 (n,), values float64 (n, 8, 4), see QUANTITIES.

    What was read, and the command that the step made of it in the same tick.
    """

    first_tick: int
    lost: dict[str, int] = {}  # messages by topic, of batches that a full queue refused since the start
    at_ns: bytes
    values: bytes
    contacts: tuple[Contact, ...] = ()
    commands: tuple[OperatorCommand, ...] = ()  # of the operator in these ticks, without heartbeats
    ages: LinkAges
    snapshot: ControlSnapshot


class HandFrame(Struct, frozen=True, kw_only=True, tag="hand"):
    """Perception, one frame; keypoints as bytes of float64: image_px (21, 2), world_m (21, 3), empty without a hand."""

    report: TriggerReport
    lost: int  # frames that a full queue refused since the start
    image_px: bytes = b""
    world_m: bytes = b""


class Picture(Struct, frozen=True, kw_only=True, tag="picture"):
    """Perception, one frame's picture, made smaller."""

    captured_ns: int
    image_jpeg: bytes
    depth_png: bytes = b""  # 16 bits, mm; 0: no measurement; empty: the camera has none
    lost: int = 0  # pictures that came to nothing since the start
    incarnation: int = 0  # of the sender: a new one counts from 0


Recorded = TickBatch | HandFrame
