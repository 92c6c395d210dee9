"""What the status of `camera compare` says."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.cli.tree import command
from app.perception.comparison import Comparison
from app.perception.look import CameraSample, LookFault
from app.system.errors import AppError
from hal.errors import CameraFault, RecordingFault
from logs.reason import Reason, reason
from tests.app.evaluate.test_closed_stdout import FullStdout

ENDED = reason(RecordingFault.ENDED)
UNPLUGGED = reason(CameraFault.UNPLUGGED, camera="webcam")


def compared(*faults: Reason | None) -> Comparison:
    """Two cameras that gave a frame each, and what they ended with."""
    found = Comparison(threshold_m=0.2)
    for which in (0, 1):
        for frames in (1, 2):
            found.take(which, sample(frames))
    found.faults[:] = faults
    return found


def sample(frames: int) -> CameraSample:
    return CameraSample(
        camera="film",
        captured_ns=frames * 10**8,
        frames=frames,
        lost=0,
        latency_ms=20.0,
        distance_m=0.3,
        safe_m=0.3,
        pressed=False,
        presses=0,
    )


class FilmLooker:
    """A looker of a recording with three frames, without a process."""

    def __init__(self, *_: object, **__: object) -> None:
        self.left = [sample(frames) for frames in (1, 2, 3)]

    @property
    def ended(self) -> bool:
        return not self.left

    def receive(self) -> list[CameraSample]:
        return [self.left.pop(0)]

    def close(self) -> None:
        pass


@pytest.mark.parametrize(
    ("faults", "status"),
    [((None, None), 0), ((ENDED, ENDED), 0), ((None, ENDED), 0), ((UNPLUGGED, None), 1), ((ENDED, UNPLUGGED), 1)],
)
def test_a_recording_that_ends_is_no_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, faults: tuple[Reason | None, Reason | None], status: int
) -> None:
    monkeypatch.setattr("app.cli.camera.compare_cameras", lambda *_, **__: compared(*faults))
    found = CliRunner().invoke(cli, ["camera", "compare", "a.mp4", "b.mp4", "--home", str(tmp_path)])
    assert found.exit_code == status, found.output


class AbsentLooker(FilmLooker):
    """One of a camera that is not there: it is tried again and again, and gives nothing."""

    ended = False

    def receive(self) -> list[Reason]:  # type: ignore[override]
        return [UNPLUGGED]


def test_a_camera_that_gives_no_first_frame_is_refused_with_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "hand.task").touch()  # it is not come to
    (tmp_path / "config.toml").write_text(f'model = "{tmp_path / "hand.task"}"\n')
    monkeypatch.setattr("app.cli.compare_cameras.Looker", AbsentLooker)
    monkeypatch.setattr("app.cli.compare_cameras.READY_S", 3600.0)
    arguments = ["camera", "compare", "digital-hand", "digital-hand", "--home", str(tmp_path)]
    with pytest.raises(AppError) as refused:
        command().main(arguments, standalone_mode=False)
    assert refused.value.code is LookFault.NO_FRAME
    assert refused.value.values == {"camera": "digital-hand", "why": UNPLUGGED}


def test_a_full_stdout_costs_neither_table_nor_plot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "hand.task").touch()  # it is not come to
    (tmp_path / "config.toml").write_text(f'model = "{tmp_path / "hand.task"}"\n')
    monkeypatch.setattr("app.cli.compare_cameras.Looker", FilmLooker)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "stdout", FullStdout())
    arguments = ["digital-hand", "digital-hand", "--csv", "o.csv", "--plot", "o.png", "--home", "."]
    with pytest.raises(OSError, match="No space left"):
        command().main(["camera", "compare", *arguments], standalone_mode=False)
    rows = [line.split(",")[1:3] for line in Path("o.csv").read_text().splitlines()[1:]]
    assert rows == [["film", "1"], ["film (2)", "1"]]
    assert Path("o.png").stat().st_size > 1000
