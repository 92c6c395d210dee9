"""Under which role a demonstration stands in the trail."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.audit.process import start_record
from app.demo import session as demo
from app.system.authority import DEMONSTRATION
from app.system.config import Config, SessionSetup
from app.system.operators import Role
from app.system.paths import Home
from app.text.recorded import render_recorded
from logs.reason import Reason


class StartedError(Exception):
    """Instead of a session."""


def test_a_demonstration_is_no_engineer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[SessionSetup] = []

    def host(setup: SessionSetup) -> object:
        begun.append(setup)
        raise StartedError

    monkeypatch.setattr(demo, "SessionHost", host)
    with pytest.raises(StartedError):
        demo.run_session(Home(tmp_path), Config(), (), click_s=1.0, presses=1, watch=print)
    role = start_record(begun[0]).role
    assert role == DEMONSTRATION
    assert role not in {each.value for each in Role}
    assert render_recorded(Reason("Record.SignIn", {"name": "demo", "role": role})) == "demo signs in as demonstration"
