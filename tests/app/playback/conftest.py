"""One recorded session that several tests look at."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing

import pytest

from app.playback.session import Playback
from tests.support.recorded_session import Lived, lived


@pytest.fixture(scope="session")
def session(tmp_path_factory: pytest.TempPathFactory) -> Lived:
    """One that several tests look at."""
    live = lived(tmp_path_factory.mktemp("playback"))
    return Lived(live, live.close())


@pytest.fixture
def playback(session: Lived) -> Iterator[Playback]:
    """Open."""
    with closing(Playback(session.path)) as opened:
        yield opened
