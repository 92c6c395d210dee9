"""A second camera beside the session's: its picture, its figures, a ruler, and what is kept of them."""

from __future__ import annotations

import asyncio
from threading import Event

import pytest
from msgspec.structs import replace
from textual.widgets import Input

from app.console.screens import compare
from app.console.screens.compare import POLL_S, CompareScreen
from app.console.widgets.comparison import FrameCount
from app.ipc.messages import HandCommand, Preview, TriggerReport
from app.perception.look import CameraSample
from app.system.config import SessionSetup
from app.system.paths import Home
from app.text.catalogue import render, tr
from hal.errors import CameraFault
from kgdfa.gesture import Gesture
from logs.reason import Reason, reason
from logs.records import Body, CameraComparison
from profiles.schema import DistanceUsed
from testing.messages import without_hand
from tests.app.console.conftest import Console, Opener, change_language, three_beats

MS = 1_000_000
PREVIEW = Preview(sequence=1, captured_ns=1, width_px=4, height_px=2, rgb=bytes(24))


class FakeLooker:
    """A camera that looks, without its process; a frame with each call."""

    made: list[FakeLooker]
    fault: Reason | None = None
    stopped = False  # its process stands still
    may_close: Event  # until then its driver hangs

    def __init__(self, setup: SessionSetup) -> None:
        self.setup = setup
        self.frames = 0
        self.closed = False
        self.commands: list[HandCommand] = []
        self.made.append(self)

    def move_hand(self, command: HandCommand) -> None:
        self.commands.append(command)

    def receive(self) -> list[CameraSample | Preview | Reason]:
        if self.fault is not None:
            return [self.fault]
        if self.stopped:
            return []
        self.frames += 1
        sample = CameraSample(
            camera="second",
            captured_ns=self.frames * 10**8,
            frames=self.frames,
            lost=0,
            latency_ms=40.0,
            distance_m=0.31,
            safe_m=0.31,
            pressed=False,
            presses=0,
            by_depth=True,
        )
        return [sample, PREVIEW]

    def close(self) -> None:
        self.may_close.wait()
        self.closed = True


@pytest.fixture
def looking(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second camera is a fake."""
    FakeLooker.made, FakeLooker.fault, FakeLooker.may_close = [], None, Event()
    FakeLooker.may_close.set()
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


@pytest.mark.usefixtures("looking")
async def test_a_comparison_is_kept_when_the_program_is_left(
    console: Opener, home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept: list[tuple[bool, Body]] = []
    async with console() as open_console:
        app = open_console.app
        monkeypatch.setattr(app.trail, "emit", lambda body: kept.append((app.trail._sink is not None, body)))
        await open_console.press("v")
        await choose_second(open_console, "digital-d435i")
        await open_console.shows("31.0 cm")
        await open_console.press("ctrl+q")
        await open_console.until(lambda: app._exit)
    ((was_open, record),) = ((was_open, body) for was_open, body in kept if isinstance(body, CameraComparison))
    assert was_open, "it belongs in the session's trail"
    assert "second" in (home.root / "comparisons" / record.path).read_text()


def counted(*reports: TriggerReport) -> tuple[int, int]:
    """Frames and lost ones after these reports."""
    count = FrameCount()
    for report in reports:
        count.take(report)
    return count.frames, count.lost


def at(ms: int, sequence: int, *, fps: float, hand: bool = True) -> TriggerReport:
    return replace(without_hand(ms * MS, sequence, 0.2), hand=hand, fps=fps)


def test_reports_without_a_new_image_are_no_frames() -> None:
    """Of a camera at 5 Hz: perception reports after 0.1 s without an image, too."""
    seen = (at(100, 1, fps=5), at(100, 2, fps=5, hand=False), at(300, 3, fps=5), at(500, 5, fps=5))
    assert counted(*seen) == (3, 0)


def test_frames_that_the_console_has_missed_count() -> None:
    assert counted(at(100, 1, fps=30), at(200, 4, fps=30), at(233, 5, fps=30)) == (5, 0)


def test_only_frames_after_the_first_hand_are_lost() -> None:
    hands = (False, False, True, False, True, False)
    assert counted(*(at(33 * (n + 1), n + 1, fps=30, hand=hand) for n, hand in enumerate(hands))) == (6, 2)


async def test_the_session_s_camera_that_gives_nothing_says_why(console: Opener) -> None:
    async with console() as open_console:
        host = open_console.host
        await open_console.press("5", "v")
        await open_console.shows("30.5 cm")
        host.message = replace(
            at(0, 2, fps=30, hand=False), camera_fault=reason(CameraFault.UNPLUGGED, camera="webcam")
        )
        await open_console.shows("was unplugged")


async def test_what_is_no_distance_is_told(console: Opener) -> None:
    async with console() as open_console:
        await open_console.press("v", "r", *"far", "enter")
        await open_console.shows("Type the distance in cm")


@pytest.mark.usefixtures("looking")
async def test_two_digital_hands_are_one_hand(console: Opener) -> None:
    """The second one is where the keys have led the first one, and follows it from then on."""
    async with console() as open_console:
        await open_console.press("4", "minus", "minus", "up", "p", "v")
        await choose_second(open_console, "digital-d435i")
        await open_console.until(lambda: FakeLooker.made and FakeLooker.made[0].commands)
        (begun,) = FakeLooker.made[0].commands
        assert (begun.gesture, begun.press) == (Gesture.FOUR, True)
        assert (begun.move_x_m, begun.move_y_m, begun.move_z_m) == (0.0, -0.02, 0.04)
        await open_console.press("5", "enter")
        await open_console.until(lambda: open_console.host.hands[-1].click_s)
        assert FakeLooker.made[0].commands[1:] == open_console.host.hands[-2:]
        assert open_console.host.hands[-2].gesture is Gesture.FIVE


@pytest.mark.usefixtures("looking")
async def test_a_disk_that_refuses_is_told_and_the_comparison_stays_until_asked_again(
    console: Opener, home: Home, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with console() as open_console:
        kept = list[Body]()
        monkeypatch.setattr(open_console.app.trail, "emit", kept.append)
        home.root.mkdir(parents=True, exist_ok=True)
        (home.root / "comparisons").write_text("a file where the folder should be")
        await open_console.press("v")
        await choose_second(open_console, "digital-d435i")
        await open_console.shows("31.0 cm")
        await open_console.press("escape")
        await open_console.tells("make room on that disk and try again")
        assert isinstance(open_console.app.screen, CompareScreen)
        assert not FakeLooker.made[0].closed
        assert not kept
        await open_console.press("escape")
        await open_console.until(lambda: FakeLooker.made[0].closed)
        await open_console.until(lambda: not isinstance(open_console.app.screen, CompareScreen))
    (record,) = (body for body in kept if isinstance(body, CameraComparison))
    assert record.path == ""
    assert record.cameras[1] == "second", "the trail has the totals all the same"


@pytest.mark.usefixtures("looking")
async def test_a_camera_whose_driver_hangs_holds_nobody_up(console: Opener) -> None:
    async with console() as open_console:
        FakeLooker.may_close.clear()
        await open_console.press("v")
        await choose_second(open_console, "digital-d435i")
        await open_console.shows("31.0 cm")
        await open_console.press("escape")
        await open_console.until(lambda: not isinstance(open_console.app.screen, CompareScreen))
        assert not FakeLooker.made[0].closed
        FakeLooker.may_close.set()
        await open_console.until(lambda: FakeLooker.made[0].closed)


@pytest.mark.usefixtures("looking")
async def test_a_camera_that_vanishes_says_so_in_place_of_its_figures(console: Opener) -> None:
    async with console(size=(120, 36)) as open_console:
        await open_console.press("v")
        await choose_second(open_console, "digital-d435i")
        await open_console.shows("31.0 cm")
        FakeLooker.fault = reason(CameraFault.UNPLUGGED, camera="second")
        await open_console.shows(render(FakeLooker.fault))
        await open_console.shows(tr("picture.stale"))


@pytest.mark.usefixtures("looking")
async def test_a_camera_whose_process_stands_still_has_no_figures(console: Opener) -> None:
    async with console(size=(120, 36)) as open_console:
        await open_console.press("v")
        await choose_second(open_console, "digital-d435i")
        await open_console.shows("31.0 cm")
        (looker,) = FakeLooker.made
        looker.stopped = True
        await open_console.until(lambda: "31.0 cm  depth" not in open_console.text())
        await open_console.shows(tr("picture.stale"))
        looker.stopped = False
        await open_console.shows("31.0 cm  depth")


async def test_the_session_s_camera_without_reports_has_no_figures(console: Opener) -> None:
    async with console() as open_console:
        await open_console.press("5", "v")
        await open_console.shows("30.5 cm")
        open_console.host.silent = True
        await open_console.until(lambda: "30.5 cm" not in open_console.text())


@pytest.mark.usefixtures("looking")
async def test_the_session_s_picture_is_asked_for_in_the_size_that_is_shown(console: Opener) -> None:
    async with console(size=(200, 50)) as open_console:
        asked = open_console.host.perception_commands
        before = asked[-1].preview_width_px
        await open_console.press("v")
        await open_console.until(lambda: asked[-1].preview_width_px != before)
        await open_console.press("escape")
        await open_console.until(lambda: asked[-1].preview_width_px == before)


@pytest.mark.usefixtures("looking")
@pytest.mark.parametrize("size", [(80, 24), (120, 36), (200, 50)])
async def test_the_table_has_every_column_whole(console: Opener, size: tuple[int, int]) -> None:
    async with console(size=size) as open_console:
        await open_console.press("v")
        await choose_second(open_console, "digital-d435i")
        await open_console.press("r", *"30", "enter")
        await open_console.shows("+3.3%")
        lines = open_console.text().splitlines()
        place = next(number for number, line in enumerate(lines) if "ruler cm" in line)
        heading, *rows = lines[place : place + 5]
        (row,) = (line for line in rows if "30.0" in line and "second" in line)
        assert row.split()[0:4] == ["30.0", "second", "31.0", "+3.3%"]
        assert len(row.split()) == 10
        assert heading.rstrip().endswith("false" if size[0] == 80 else "false presses")


async def test_a_ruler_that_is_no_distance_stays_to_be_corrected(console: Opener) -> None:
    async with console() as open_console:
        await open_console.press("v")
        await open_console.until(lambda: isinstance(open_console.app.screen, CompareScreen))
        ruler = open_console.app.screen.query_one("#ruler", Input)
        await open_console.press("r", *"5-", "enter")
        await open_console.tells("Type the distance")
        assert ruler.has_focus
        assert ruler.value == "5-"
        await open_console.press("backspace", "enter")
        await open_console.until(lambda: not ruler.has_focus)
        assert open_console.host.hands == []


@pytest.mark.usefixtures("looking")
async def test_another_language_while_a_second_camera_looks(console: Opener, monkeypatch: pytest.MonkeyPatch) -> None:
    async with console(size=(120, 36)) as open_console:
        app = open_console.app
        await open_console.press("v")
        await choose_second(open_console, "digital-d435i:4@15")
        await open_console.shows("31.0 cm")
        (looker,) = FakeLooker.made
        await change_language(open_console.pilot, monkeypatch, lambda: three_beats(app.screen, POLL_S))
        await open_console.shows(tr("compare.ruler"))
        frames = looker.frames
        await open_console.until(lambda: looker.frames > frames)
        await open_console.shows("31.0 cm")


@pytest.mark.usefixtures("looking")
async def test_another_language_while_a_second_camera_is_opened(
    console: Opener, monkeypatch: pytest.MonkeyPatch
) -> None:
    may_open = Event()

    def opens(_: object, __: object) -> None:
        assert may_open.wait(20)

    monkeypatch.setattr(compare, "refuse_same_device", opens)
    async with console(size=(120, 36)) as open_console:
        app = open_console.app
        await open_console.press("v")
        await choose_second(open_console, "digital-d435i:4@15")

        async def meanwhile() -> None:
            may_open.set()
            await asyncio.gather(*(worker.wait() for worker in app.workers if worker.node is app.screen))

        await change_language(open_console.pilot, monkeypatch, meanwhile)
        await open_console.shows(tr("compare.ruler"))
        await open_console.shows("31.0 cm")
