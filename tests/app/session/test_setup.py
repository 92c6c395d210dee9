"""Who may begin a session on real joints, and what its start puts on record."""

from __future__ import annotations

import os
import shutil
import tempfile
from contextlib import closing
from pathlib import Path

import pytest

from app.ipc import streams
from app.ipc.links import OrderedReceiver, address
from app.ipc.messages import OperatorCommand
from app.session.setup import make_setup
from app.session.shared import encode
from app.system.authority import demonstration
from app.system.config import Config, JointsConfig
from app.system.errors import AppError
from app.system.operators import Permission, Role
from app.system.paths import Home
from logs.journal import CHANGES
from logs.read import records
from logs.records import Change
from profiles.schema import DEMO_PATIENT
from testing.authors import signed_in

REAL = Config(joints=JointsConfig(kind="can"))
EMULATED = Config(joints=JointsConfig(kind="can", interface="local"))


def test_real_joints_take_a_sign_in_that_may_move_a_patient(tmp_path: Path) -> None:
    home = Home(tmp_path)
    with pytest.raises(AppError, match="SIGN_IN_NEEDED"):
        make_setup(home, REAL, DEMO_PATIENT, None)
    with pytest.raises(AppError, match="NOT_ALLOWED"):
        make_setup(home, REAL, DEMO_PATIENT, signed_in(home, Role.REVIEWER))
    with pytest.raises(AppError, match="SIGN_IN_NEEDED"):
        demonstration(home, REAL.joints)
    setup = make_setup(home, REAL, DEMO_PATIENT, signed_in(home))
    assert (setup.operator, setup.role) == ("Ada", "engineer")
    setup = make_setup(home, EMULATED, DEMO_PATIENT, demonstration(home, EMULATED.joints))
    assert (setup.operator, setup.role) == ("demo", "demonstration")
    assert not demonstration(home, EMULATED.joints).may(Permission.EDIT_PATIENTS)
    setup = make_setup(home, Config(), DEMO_PATIENT, None)
    assert (setup.operator, setup.role) == ("", "")


@pytest.mark.parametrize("name", ["d" * 90, "a\u00e9", os.fsdecode(b"h\xff")], ids=["long", "letter", "bytes"])
def test_a_session_has_sockets_whatever_the_temporary_folder_is_called(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    folder = tmp_path / name
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    setup = make_setup(Home(tmp_path), Config(), DEMO_PATIENT, None)
    try:
        assert setup.links.path.stat().st_mode & 0o777 == 0o700
        names = [one.name for one in vars(streams).values() if isinstance(one, streams.Stream)]
        with closing(OrderedReceiver(address(setup.links, max(names, key=len)), OperatorCommand)):
            assert [one.suffix for one in setup.links.path.iterdir()] == [".sock"]
        assert encode(setup)
    finally:
        shutil.rmtree(setup.links.path)


def test_a_configuration_changed_by_an_editor_is_on_record_once(tmp_path: Path) -> None:
    home = Home(tmp_path)
    for text in ("", 'theme = "light"\n', 'theme = "light"\n', 'theme = "dark"\n'):
        if text:
            home.config.write_text(text)
        make_setup(home, REAL, DEMO_PATIENT, signed_in(home))
    found = [record for record in records(home.logs / CHANGES) if isinstance(record.body, Change)]
    bodies = [record.body for record in found if isinstance(record.body, Change)]
    assert [(record.operator, body.subject) for record, body in zip(found, bodies, strict=True)] == [
        ("Ada", "configuration")
    ] * 2
    assert bodies[1].values["sha256"][0] == bodies[0].values["sha256"][1]
