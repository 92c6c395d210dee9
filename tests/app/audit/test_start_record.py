"""What a trail's first record says of the programs and files that decide."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

import pytest

from app.audit.process import start_record
from app.session.setup import make_setup
from app.system.config import Config
from app.system.paths import Home
from profiles.schema import DEMO_PATIENT


@pytest.mark.parametrize("model", ["~/x.task", "{folder}/x.task"])
def test_the_configured_hand_model_is_named_by_its_hash(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, model: str
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "x.task").write_bytes(b"networks")
    config = Config(model=model.format(folder=tmp_path))
    setup = make_setup(Home(tmp_path / "home"), config, DEMO_PATIENT, None)
    assert start_record(setup).versions["hand model, SHA-256"] == sha256(b"networks").hexdigest()
    setup.links.path.rmdir()
