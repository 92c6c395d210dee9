"""What every test shares."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, settings

from app.text import catalogue
from app.text.compile import compile_catalogues

# A busy machine is slow, not wrong: time limits belong to `make bench`.
settings.register_profile("rleex", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("rleex")

compile_catalogues()


@pytest.fixture(autouse=True)
def _strict_text() -> Iterator[None]:
    """English, and a key that no catalogue has fails the test that asks for it."""
    catalogue.be_strict()
    yield
    catalogue.use_language("en")
    catalogue.be_strict(False)
