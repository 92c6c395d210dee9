"""What the camera saw: camera, calibration, gestures, presses."""

from __future__ import annotations

from msgspec import Struct

from logs.bodies.values import Measured


class Camera(Struct, frozen=True, kw_only=True, tag_field="kind", tag="camera"):
    """A camera was opened, with the intrinsics in use."""

    camera: str
    camera_kind: str = ""
    width_px: int
    height_px: int
    rate_hz: float
    focal_px: float
    intrinsics_source: str
    mirrored: bool = False


class Calibration(Struct, frozen=True, kw_only=True, tag_field="kind", tag="calibration"):
    """The palm anchor in use and where it comes from."""

    method: str
    anchor_m: float
    focal_px: float
    residual_m: Measured = None
    text: str = ""


class Recording(Struct, frozen=True, kw_only=True, tag_field="kind", tag="recording"):
    """Recording of the camera's frames began or ended, and whether the patient's consent was noted."""

    on: bool
    consent: bool
    path: str = ""


class GestureOnset(Struct, frozen=True, kw_only=True, tag_field="kind", tag="gesture"):
    """The voted gesture became another one; null is none of the twelve."""

    gesture: str | None
    confidence: float = 0.0
    explanation: str = ""
    votes: int = 0
    captured_ns: int = 0
    distance_m: Measured = None


class Press(Struct, frozen=True, kw_only=True, tag_field="kind", tag="press"):
    """The virtual button went down."""

    gesture: str | None
    captured_ns: int
    distance_m: Measured = None
    threshold_m: Measured = None


class Cancel(Struct, frozen=True, kw_only=True, tag_field="kind", tag="cancel"):
    """A press ended without a command."""

    reason: str
    gesture: str | None = None
    captured_ns: int = 0


class Release(Struct, frozen=True, kw_only=True, tag_field="kind", tag="release"):
    """A press ended by withdrawal: the wearer's wish."""

    gesture: str | None
    recognised_ns: int
    captured_ns: int
    distance_m: Measured = None
    number: int = 0  # release count of the perception process
