"""Records of perception: camera, calibration, and what gesture and button decided."""

from __future__ import annotations

from msgspec import Struct

from logs.reason import Cause, Measured


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
    measured_hz: Measured = None  # over `frames` captures; the record is repeated with it, after seconds and at the end
    frames: int = 0


class Calibration(Struct, frozen=True, kw_only=True, tag_field="kind", tag="calibration"):
    """The palm anchor in use and where it comes from."""

    method: str
    anchor_m: float
    focal_px: float
    residual_m: Measured = None  # of a calibration's fit, on the anchor
    sd_m: Measured = None  # expected error of the anchor
    focal_source: str = ""
    text: Cause = None


class Recording(Struct, frozen=True, kw_only=True, tag_field="kind", tag="recording"):
    """Recording of the camera's pictures began or ended, by the patient's consent; without it they are deleted."""

    on: bool
    consent: bool
    path: str = ""


class Button(Struct, frozen=True, kw_only=True, tag_field="kind", tag="button"):
    """The virtual button begins anew, as it is set up: its rule, its place on the image, its threshold."""

    mode: str
    x_px: float
    y_px: float
    radius_px: float
    threshold_m: float
    distance_source: str = ""  # monocular, depth or both; empty: recorded before there was a choice, monocular


class Frames(Struct, frozen=True, kw_only=True, tag_field="kind", tag="frames"):
    """What vote and button took from each of some frames in a row, in columns; before the decision that they led to.

    Frames are numbered from the newest `Button` on. `hands` has a character a frame: `.` no hand, `h` a hand; `x` and
    `n` if another hand commands than before; `H` and `N` if it is partly out of the image. The columns after it hold
    frames with a hand only.
    """

    number: int  # of the first frame
    captured_ns: int  # of the first frame
    after_ns: tuple[int, ...] = ()  # of each other one since the one before
    hands: str = ""
    gesture: tuple[str | None, ...] = ()  # of this frame alone
    confidence: tuple[float, ...] = ()
    safe_distance_m: tuple[Measured, ...] = ()
    beside_px: tuple[float, ...] = ()  # from the hand's box to the button's centre
    # What measured: `m` the keypoints, `d` a depth map, `r` that of a frame before; empty: the keypoints in every frame
    sources: str = ""
    bridge_m: tuple[Measured, ...] = ()  # in frames with `d` and `r`: what the keypoints would have decided by


class _Decided(Struct, frozen=True, kw_only=True):
    """What recognition and button compared in the frame that decided, and the calibration in force.

    Distances of one frame: shown on the screen, and the safe one, by which the button decides.
    """

    captured_ns: int = 0  # of that frame
    recognised_ns: int = 0  # capture of the frame whose vote made the gesture
    vote_ns: tuple[int, ...] = ()  # captures of the frames that voted
    distance_m: Measured = None
    safe_distance_m: Measured = None
    previous_m: Measured = None  # the safe distance measured before; over a gap as well
    threshold_m: Measured = None  # nearer is pressed
    release_m: Measured = None  # farther is released
    nearer_m: Measured = None  # since the measurement before
    nearer_limit_m: Measured = None
    beside_px: Measured = None  # from the hand's box to the button's centre
    beside_limit_px: Measured = None
    elapsed_ns: int = 0  # since the frame before
    held_ns: int = 0  # since the press
    gap_frames: int = 0
    approached_m: Measured = None  # how far the distance fell before this frame
    approach_limit_m: Measured = None  # a press needs at least this much
    elapsed_limit_ns: int = 0
    held_limit_ns: int = 0
    gap_limit_frames: int = 0
    distance_source: str = ""  # what measured the distance: monocular or depth; empty: not recorded then
    source_changed: bool = False  # since the measurement before: nothing is pressed or released in this frame
    anchor_m: Measured = None
    anchor_method: str = ""
    focal_px: Measured = None
    focal_source: str = ""


class GestureOnset(_Decided, frozen=True, kw_only=True, tag_field="kind", tag="gesture"):
    """The voted gesture became another one; null is none of the twelve."""

    gesture: str | None
    confidence: float = 0.0
    explanation: Cause = None
    votes: int = 0


class Hint(_Decided, frozen=True, kw_only=True, tag_field="kind", tag="hint"):
    """A hand came near and did not press, or it does not command at all, with the reason that the screen showed."""

    reason: Cause
    gesture: str | None = None


class Press(_Decided, frozen=True, kw_only=True, tag_field="kind", tag="press"):
    """The virtual button went down."""

    gesture: str | None


class Cancel(_Decided, frozen=True, kw_only=True, tag_field="kind", tag="cancel"):
    """A press ended without a command."""

    reason: Cause
    gesture: str | None = None
    pressed_ns: int = 0


class Release(_Decided, frozen=True, kw_only=True, tag_field="kind", tag="release"):
    """A press ended by withdrawal: the wearer's command."""

    gesture: str | None
    number: int = 0  # release count of the perception process
    pressed_ns: int = 0


class CameraComparison(Struct, frozen=True, kw_only=True, tag_field="kind", tag="camera comparison"):
    """A second camera looked beside the session's and commanded nothing: the first is the session's.

    Columns hold a value a camera, over all values of the ruler; `path` is the table's file in `comparisons/`.
    """

    cameras: tuple[str, ...]
    frames: tuple[int, ...] = ()
    fps: tuple[float, ...] = ()
    latency_ms: tuple[float, ...] = ()
    lost: tuple[float, ...] = ()  # share of the frames without keypoints
    distance_m: tuple[Measured, ...] = ()
    from_other_m: tuple[Measured, ...] = ()  # how much farther than the other one
    presses_true: tuple[int, ...] = ()  # by the ruler, else by the other camera
    presses_false: tuple[int, ...] = ()
    rulers_m: tuple[float, ...] = ()  # that were typed in
    path: str = ""


PerceptionBody = (
    Camera
    | Calibration
    | Recording
    | Button
    | Frames
    | GestureOnset
    | Hint
    | Press
    | Cancel
    | Release
    | CameraComparison
)
