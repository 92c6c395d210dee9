"""The joints by name: apart from their arrays, for who only names them."""

from __future__ import annotations

from enum import IntEnum


class Joint(IntEnum):
    """The four driven joints, and their index in every (4,) array."""

    LEFT_HIP = 0
    LEFT_KNEE = 1
    RIGHT_HIP = 2
    RIGHT_KNEE = 3
