"""A second camera beside the session's: its picture, its figures, a ruler, and what is kept of them."""

from __future__ import annotations

import pytest
from textual.widgets import Input

from app.console.screens import compare
from app.console.screens.compare import CompareScreen
from app.ipc.messages import Preview
from app.perception.look import CameraSample
from app.system.config import SessionSetup
from app.system.paths import Home
from app.text.catalogue import tr
from logs.records import Body, CameraComparison
from profiles.schema import DistanceUsed
from tests.app.console.conftest import Console, Opener

PREVIEW = Preview(sequence=1, captured_ns=1, width_px=4, height_px=2, rgb=bytes(24))


class FakeLooker:
    """A camera that looks, without its process; a frame with each call."""

    made: list[FakeLooker]

    def __init__(self, setup: SessionSetup) -> None:
        self.setup = setup
        self.frames = 0
        self.closed = False
        self.made.append(self)

    def receive(self) -> list[CameraSample | Preview]:
        self.frames += 1
        sample = CameraSample(
            camera="second",
            captured_ns=self.frames * 10**8,
            frames=self.frames,
            lost=0,
            latency_ms=40.0,
            hand=True,
            distance_m=0.31,
            safe_m=0.31,
            pressed=False,
            presses=0,
            by_depth=True,
        )
        return [sample, PREVIEW]

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def looking(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second camera is a fake."""
    FakeLooker.made = []
    monkeypatch.setattr(compare, "Looker", FakeLooker)


async def choose_second(open_console: Console, source: str) -> None:
    """Name the second camera on the compare screen; an empty name: none."""
    await open_console.until(lambda: isinstance(open_console.app.screen, CompareScreen))
    await open_console.press("2")
    open_console.app.screen.query_one("#second", Input).value = source
    await open_console.press("enter")


@pytest.mark.usefixtures("looking")
async def test_a_second_camera_is_compared_and_kept(
    console: Opener, home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with console() as open_console:
        app, kept = open_console.app, list[Body]()
        monkeypatch.setattr(app.trail, "emit", kept.append)
        await open_console.press("v")
        await choose_second(open_console, "digital-d435i:4@15")
        await open_console.shows("31.0 cm")
        (looker,) = FakeLooker.made
        assert (looker.setup.config.camera.seed, looker.setup.config.camera.rate_hz) == (4, 15.0)
        assert looker.setup.profile.distance_source is DistanceUsed.DEPTH
        await open_console.press("r", *"30", "enter")
        await open_console.shows("+3.3%")
        await open_console.press("escape")
        await open_console.until(lambda: looker.closed)
    (record,) = (body for body in kept if isinstance(body, CameraComparison))
    assert record.cameras[1] == "second"
    assert record.rulers_m == (0.3,)
    assert (home.root / "comparisons" / record.path).read_text().startswith("ruler_cm,camera")


@pytest.mark.usefixtures("looking")
async def test_another_camera_keeps_what_the_one_before_it_gave_and_no_name_leaves_none(
    console: Opener, home: Home
) -> None:
    async with console() as open_console:
        await open_console.press("v")
        await choose_second(open_console, "digital-d435i:4@15")
        screen = open_console.app.screen
        await open_console.shows("31.0 cm")
        assert screen.query_one("#other").display
        await choose_second(open_console, "")
        await open_console.until(lambda: FakeLooker.made[0].closed)
        assert len(FakeLooker.made) == 1
        assert len([*(home.root / "comparisons").iterdir()]) == 1
        assert not screen.query_one("#other").display
        await open_console.shows(tr("compare.depth"))


async def test_what_is_no_distance_is_told(console: Opener) -> None:
    async with console() as open_console:
        await open_console.press("v", "r", *"far", "enter")
        await open_console.shows("Type the distance in cm")
