"""What the status of `camera compare` says."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.perception.comparison import Comparison
from app.perception.look import CameraSample
from hal.errors import CameraFault, RecordingFault
from logs.reason import Reason, reason

ENDED = reason(RecordingFault.ENDED)
UNPLUGGED = reason(CameraFault.UNPLUGGED, camera="webcam")


def compared(*faults: Reason | None) -> Comparison:
    """Two cameras that gave a frame each, and what they ended with."""
    found = Comparison(threshold_m=0.2)
    for which in (0, 1):
        for frames in (1, 2):
            found.take(
                which,
                CameraSample(
                    camera="film",
                    captured_ns=frames * 10**8,
                    frames=frames,
                    lost=0,
                    latency_ms=20.0,
                    distance_m=0.3,
                    safe_m=0.3,
                    pressed=False,
                    presses=0,
                ),
            )
    found.faults[:] = faults
    return found


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
