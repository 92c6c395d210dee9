"""Errors compared by code and values, never by wording."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum

import pytest

from hal.errors import HardwareError


@contextmanager
def refused(code: Enum, **values: object) -> Iterator[None]:
    """Expect a HardwareError with this code, and with at least these values."""
    with pytest.raises(HardwareError) as caught:
        yield
    assert caught.value.code is code, caught.value
    assert {name: caught.value.values.get(name) for name in values} == values
