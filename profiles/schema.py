"""The patient profile: what the program must know of a wearer. SI inside; cm and degrees in files."""

from __future__ import annotations

from datetime import datetime
from enum import Enum
from typing import Annotated

from msgspec import Meta, Struct

Count = Annotated[int, Meta(ge=0)]
Share = Annotated[float, Meta(ge=0.0, le=1.0)]


class Sex(Enum):
    """As the anthropometric tables divide their samples."""

    FEMALE = "female"
    MALE = "male"


class HandUsed(Enum):
    """Which hand commands; EITHER takes whichever is nearest."""

    LEFT = "left"
    RIGHT = "right"
    EITHER = "either"


class GestureUsed(Enum):
    """The twelve gestures of Table 1, by the names that `kgdfa.gesture.Gesture` gives them."""

    ZERO = "0"
    ONE = "1"
    TWO = "2"
    THREE = "3"
    FOUR = "4"
    FIVE = "5"
    SIX = "6"
    SEVEN = "7"
    EIGHT = "8"
    NINE = "9"
    LOVE = "love"
    ROCK = "rock"


class DistanceUsed(Enum):
    """Which distance commands: the keypoints', a depth camera's, or depth with its holes bridged by the keypoints."""

    MONOCULAR = "monocular"
    DEPTH = "depth"
    BOTH = "both"


class Population(Enum):
    """Named models that estimate palm width from sex and stature."""

    GB10000_88 = "gb10000-88"
    ANSUR2 = "ansur2"


class GaitParameters(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the patient's steps look like; ranges in `fields.py`."""

    step_length_m: float = 0.30  # from one foot's place to the other foot's, along the floor
    swing_clearance_m: float = 0.05
    step_time_s: float = 2.0
    stair_rise_m: float = 0.12
    stair_tread_m: float = 0.28
    obstacle_height_m: float = 0.10
    obstacle_depth_m: float = 0.08
    chair_height_m: float = 0.48
    transfer_time_s: float = 4.0  # sit down, stand up
    body_weight_support: float = 0.5  # share of the weight a harness or crutches carry, 0-1
    assist_left: float = 1.0  # gain scale of the weak side, 0-1
    assist_right: float = 1.0


class Palm(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the reference segment is known: measured width wins over the estimate; a calibration wins over both."""

    measured_width_m: float | None = None
    population: Population = Population.GB10000_88


class Calibration(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """f·H solved at a known distance for one patient and one camera (Eq. 4 turned round)."""

    camera: str
    focal_anchor_px_m: float
    focal_px: float
    distance_m: float
    residual: float  # relative spread of the samples
    calibrated_at: str  # ISO 8601, UTC
    width_px: int = 0  # of the images it was made with; 0: unknown
    height_px: int = 0  # 0: unknown, from before it was kept


class GestureEvidence(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How one gesture was recognised in an enrolment, with exact bounds of 95 % (`kgdfa/vocabulary.py`)."""

    gesture: GestureUsed
    frames: Count
    recognised: Count
    mistaken: Count  # taken for another gesture
    recognised_at_least: Share
    mistaken_at_most: Share


class VocabularyEvidence(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What an enrolment proved: which gestures may command, of all that were shown, and the idle hand's frames."""

    proven_at: Annotated[datetime, Meta(tz=True)]
    model: str  # SHA-256 of what recognised (`app/system/vocabulary.py`)
    hand: HandUsed | None = None  # that was shown; None: unknown, from before it was kept
    vocabulary: tuple[GestureUsed, ...] = ()  # empty ones stand in no file
    idle_frames: Count
    idle_taken: Count  # for a gesture of the vocabulary
    idle_at_most: Share
    gestures: tuple[GestureEvidence, ...] = ()


class DoseTargets(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a session aims at."""

    steps: int = 100
    distance_m: float = 30.0
    duration_s: float = 1200.0


class Profile(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One patient, pseudonymous. Lengths measured on the patient win over those estimated from stature."""

    schema: int = 1
    identifier: str  # pseudonym: letters, digits, hyphen
    sex: Sex
    stature_m: float
    mass_kg: float
    hand: HandUsed = HandUsed.RIGHT
    vocabulary: tuple[GestureUsed, ...] = tuple(GestureUsed)  # the gestures that may command; in files one text
    evidence: VocabularyEvidence | None = None  # of the vocabulary; None: nobody enrolled it
    distance_source: DistanceUsed = DistanceUsed.MONOCULAR
    palm: Palm = Palm()
    calibrations: tuple[Calibration, ...] = ()
    thigh_length_m: float | None = None
    shank_length_m: float | None = None
    press_threshold_m: float = 0.20
    gait: GaitParameters = GaitParameters()
    dose: DoseTargets = DoseTargets()
    hip_max_rad: float | None = None  # the patient's own range where it is narrower than the device's
    knee_max_rad: float | None = None
    archived: bool = False
    note: str = ""


DEMO_PATIENT = Profile(identifier="demo", sex=Sex.FEMALE, stature_m=1.70, mass_kg=65.0)
