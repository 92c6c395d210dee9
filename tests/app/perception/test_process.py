"""The perception process: when it says that recognition runs."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from app.ipc.links import Address, new_link_directory
from app.ipc.messages import TriggerReport
from app.perception import pipeline, process
from app.perception.process import Perception
from app.system.config import CameraConfig, Config, SessionSetup
from profiles.schema import DEMO_PATIENT


class NoHands:
    """A detector that finds nothing, and counts its frames."""

    def __init__(self) -> None:
        self.frames = 0

    def detect(self, _image: object, _captured_ns: int) -> tuple[()]:
        self.frames += 1
        return ()

    def follow(self, _hand: object, _unknown: bool, _sought: object) -> None:
        """Nothing is tracked."""

    def close(self) -> None:
        """Nothing is open."""


class Sink:
    """Takes every record."""

    def __init__(self, *_: object) -> None:
        pass

    def emit(self, _body: object) -> bool:
        return True

    def close(self) -> None:
        """Nothing is open."""


def test_the_frame_in_which_the_pipeline_is_built_still_counts_as_loading(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    detector, sent = NoHands(), list[tuple[int, bool]]()

    class Publisher:
        def __init__(self, _at: Address) -> None:
            pass

        def send(self, message: Any) -> None:
            if isinstance(message, TriggerReport):
                sent.append((detector.frames, message.detector_ready))
                if message.detector_ready or len(sent) > 1000:
                    perception.end()

        def foreign_peers(self) -> int:
            return 0

        def close(self) -> None:
            """Nothing is open."""

    monkeypatch.setattr(process, "Publisher", Publisher)
    monkeypatch.setattr(process, "AuditSink", Sink)
    monkeypatch.setattr(process, "gc_freeze", lambda: None)
    monkeypatch.setattr(pipeline, "make_detector", lambda _: detector)
    (tmp_path / "links").mkdir()
    perception = Perception(
        SessionSetup(
            session="s",
            home=tmp_path,
            links=new_link_directory(tmp_path / "links"),
            config=Config(camera=CameraConfig(width_px=640, height_px=360)),
            profile=DEMO_PATIENT,
            operator="ann",
            host_pid=os.getppid(),
        )
    )
    perception.run()
    perception.close()
    assert sent[-2:] == [(1, False), (2, True)]
