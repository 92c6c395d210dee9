"""What profiles refuse and report, as codes with values; the catalogues hold the wording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

from logs.reading.errors import CodedError


class ProfileFault(Enum):
    """Why a profile, a change or a calibration can't be taken. The values of each are named beside it."""

    # Files and store
    IN_FILE = "in file"  # place, fault: which fault in which file
    TOML = "toml"  # detail
    UNREADABLE = "unreadable"  # path, detail
    NOT_SAVED = "not saved"  # paths, detail
    FOLDER_READ_ONLY = "folder read-only"  # path, detail
    HISTORY_UNREADABLE = "history unreadable"  # path, detail
    UNKNOWN_PATIENT = "unknown patient"  # identifier, path, known
    PATIENT_EXISTS = "patient exists"  # identifier
    OTHER_PATIENT = "other patient"  # path, identifier
    IDENTIFIER_FIXED = "identifier fixed"
    # Fields
    UNKNOWN_FIELD = "unknown field"  # field, known
    MISSPELT_FIELD = "misspelt field"  # field, close
    FIELD_TYPE = "field type"  # detail
    NO_GROUP = "no group"  # field, group
    NO_ASSIGNMENT = "no assignment"  # typed
    OUT_OF_RANGE = "out of range"  # field, value, low, high, unit: in the units of files
    SCHEMA = "schema"  # schema
    IDENTIFIER = "identifier"  # identifier
    NOTE_LENGTH = "note length"  # count, limit
    NOTE_CONTROL = "note control"
    VOCABULARY_EMPTY = "vocabulary empty"
    VOCABULARY_TWICE = "vocabulary twice"  # gesture
    WALK_WITHOUT_END = "walk without end"  # walk, end: gestures
    # Calibration
    DISTANCE = "distance"  # distance_m, low_m, high_m
    TOO_FEW_SAMPLES = "too few samples"  # count, least
    SCATTER = "scatter"  # residual, most: shares
    NO_PALM = "no palm"  # reference_m, low_m, high_m, focal_px


class ProfileError(CodedError):
    """A profile that is missing, broken or out of range."""


@dataclass(frozen=True, slots=True)
class Finding:
    """A code with its values, SI, that is no error: a doubt about a calibration, what is known of a palm."""

    code: Enum
    values: Mapping[str, object] = field(default_factory=dict)
