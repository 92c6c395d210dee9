"""A session of real processes: its recording holds what control and perception made, sample by sample."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.recording import schemas
from app.recording.read import HashCheck, Recording, check_sent, proof_of, survey, trail_of
from app.system.paths import Home, pictures_path, recording_path
from logs.read import records
from logs.records import RecordingFile, RecordingSent
from testing.recordings import contradictions, joints_are_controls
from testing.session import RealSession

pytestmark = [pytest.mark.serial, pytest.mark.xdist_group("perception")]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session that stands up, with perception and pictures."""
    root = tmp_path_factory.mktemp("real")
    with RealSession(root, perception=True, recording=True) as session:
        session.until(lambda _: session.report is not None and session.report.detector_ready, "perception")
        session.record_pictures(consent=True)
        session.stand()
        pictures = pictures_path(Home(root).logs, session.setup.session)
        session.until(lambda _: pictures.exists() and pictures.stat().st_size > 0, "pictures")
        session.finish()
    return recording_path(Home(root).logs, session.setup.session)


def test_it_agrees_with_what_control_counted_and_with_the_trail(recorded: Path) -> None:
    assert contradictions(recorded) == []
    assert joints_are_controls(recorded) >= 2


def test_the_pictures_are_whole_and_those_that_the_trail_names(recorded: Path) -> None:
    path = pictures_path(recorded.parent, recorded.stem)
    found, (proof, named) = survey(path), proof_of(path)
    assert found.whole
    assert proof is HashCheck.SAME
    assert named is not None
    assert named.messages == found.counts
    assert found.counts[schemas.IMAGE] > 0
    done = CliRunner().invoke(cli, ["recording", "verify", str(path)])
    assert done.exit_code == 0, done.output
    assert "pictures are not counted" in done.output


def test_control_and_perception_say_what_they_made_and_verify_compares_it(recorded: Path) -> None:
    made = {one.process: one.body for one in records(trail_of(recorded)) if isinstance(one.body, RecordingSent)}
    assert made.keys() == {"control", "perception"}
    done = CliRunner().invoke(cli, ["recording", "verify", str(recorded)])
    assert done.exit_code == 0, done.output
    total = sum(sum(one.messages.values()) for one in made.values())
    assert f"{total} were made" in done.output


def test_a_message_that_is_neither_there_nor_counted_is_missed(recorded: Path) -> None:
    found, (_, recorded_file) = survey(recorded), proof_of(recorded)
    assert isinstance(recorded_file, RecordingFile)
    fewer = Recording(path=recorded, counts=found.counts.copy())
    fewer.counts[schemas.JOINT_STATE] -= 25
    assert check_sent(fewer, recorded_file).missing == {schemas.JOINT_STATE: 25}
    lost = Recording(path=recorded, counts=fewer.counts, lost={schemas.JOINT_STATE: 25})
    assert check_sent(lost, None).missing == {}
    assert check_sent(found, recorded_file).known
    elsewhere = Recording(path=recorded.with_name("20261122T100000Z-0001.mcap"), counts=found.counts)
    assert not check_sent(elsewhere, None).known
