"""What kgdfa refuses, as codes with values; the catalogues hold the wording."""

from __future__ import annotations

from enum import Enum

from logs.reading.errors import CodedError


class KgdfaFault(Enum):
    """Why an image, a model or a setting can't be used. The values of each are named beside it."""

    IMAGE_EMPTY = "image empty"  # shape
    IMAGE_CHANNELS = "image channels"  # channels
    IMAGE_NUMBERS = "image numbers"  # kind: the array's type
    IMAGE_SIZE = "image size"  # width_px, height_px
    FOCAL_LENGTH = "focal length"  # focal_px
    REFERENCE_LENGTH = "reference length"  # reference_m, low_m, high_m
    DEPTH_MODE = "depth mode"  # mode
    PREPROCESSING = "preprocessing"  # name, known
    DETECTOR_CLOSED = "detector closed"
    HAND_MODEL_MISSING = "hand model missing"  # path
    HAND_MODEL_INVALID = "hand model invalid"  # path, detail
    GESTURE_MODEL_UNREADABLE = "gesture model unreadable"  # path, detail
    GESTURE_MODEL_OUTDATED = "gesture model outdated"  # path


class KgdfaError(CodedError):
    """An image, model or value that cannot be used."""
