"""What every test shares."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from pathlib import Path

import argon2
import pytest
from hypothesis import HealthCheck, settings

from app.system import operators, sign_in
from app.system.paths import find_home
from app.text import catalogue
from app.text.compile import compile_catalogues

# A busy machine is slow, not wrong: time limits belong to `make bench`.
settings.register_profile("rleex", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("rleex")

# What a user's shell sets is for the user's own sessions.
for variable in ("NO_COLOR", "RLEEX_LOG_LEVEL", "RLEEX_TOKEN"):
    os.environ.pop(variable, None)

compile_catalogues()


def pytest_collection_finish() -> None:
    """Modules and collected tests stay to the end: no collection of garbage looks at them again."""
    gc.collect()
    gc.freeze()


def pytest_unconfigure() -> None:
    """Else DuckDB's module reports what is frozen as its leak, in dozens of lines."""
    gc.unfreeze()


@pytest.fixture(autouse=True, scope="session")
def _home_of_nobody(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The user's own home has a language and more; the hand model is all that a test takes from it."""
    home = tmp_path_factory.mktemp("home")
    (home / "models").symlink_to(find_home().models.absolute())
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("RLEEX_HOME", str(home))
        yield


@pytest.fixture
def tmp_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Without the test's name in it, for a user's name may be long, and a socket's path has 107 bytes at most."""
    return tmp_path_factory.mktemp("t")


@pytest.fixture(autouse=True)
def _strict_text() -> Iterator[None]:
    """English, and a key that no catalogue has fails the test that asks for it."""
    catalogue.be_strict()
    yield
    catalogue.ask_language("")
    catalogue.use_language("en")
    catalogue.be_strict(False)


@pytest.fixture(autouse=True)
def _usual_scheduling() -> Iterator[None]:
    """No test leaves its worker at a real-time priority or on one core: what it starts later would starve it."""
    before = (os.sched_getscheduler(0), os.sched_getaffinity(0))
    yield
    assert (os.sched_getscheduler(0), os.sched_getaffinity(0)) == before


@pytest.fixture
def cheap_pins(monkeypatch: pytest.MonkeyPatch) -> None:
    """The real argon2 at a cost that lets a test try many PINs; sessions with real processes pay the whole cost."""
    cheap = argon2.PasswordHasher(time_cost=1, memory_cost=64, parallelism=1)
    monkeypatch.setattr(operators, "_hasher", lambda: cheap)
    monkeypatch.setattr(sign_in, "_STRANGER_HASH", cheap.hash("nobody's"))
