"""Pictures of the running console for the documents: real processes, digital hand, simulated joints.

`make pictures` writes docs/pictures/*.svg; about two minutes.
Scenes can be named: patients training session compare review stopped small.
"""

from __future__ import annotations

import asyncio
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import msgspec
from rich.console import Console
from textual.pilot import Pilot

from app.console.app import ConsoleApp
from app.console.screens.replay import ReplayScreen
from app.ipc.snapshot import ControlSnapshot
from app.ipc.states import Action, Effect, GaitState
from app.system.config import Config, RecordingConfig, load_config
from app.system.hand_model import set_up_model
from app.system.paths import Home, find_home
from kgdfa.gesture import Gesture
from profiles.schema import DEMO_PATIENT
from testing.fake_host import screen_text

FOLDER = Path(__file__).parent.parent / "docs" / "pictures"
SMALL, MIDDLE, LARGE = (80, 24), (120, 36), (200, 50)
SECOND = ("d", "i", "g", "i", "t", "a", "l", "minus", "d", "4", "3", "5", "i")  # keys of a camera's name
LIMIT_S = 90.0
MID_SWING = 0.3  # of an action: a foot is in the air
STEPS_TO_MID_SWING = 20  # of a 25th of a second
MEASURED_S = 5.0  # for a row's means
SETTLE_S = 0.4  # for the last picture to be drawn


@dataclass(frozen=True, slots=True)
class Photographer:
    """A console, its pilot, and where the pictures go."""

    app: ConsoleApp
    pilot: Pilot[None]

    @property
    def snapshot(self) -> ControlSnapshot | None:
        """Control's newest snapshot."""
        state = self.app.live_state()
        return None if state is None else state.snapshot

    def gesture(self) -> Gesture | None:
        """The voted gesture."""
        state = self.app.live_state()
        return None if state is None or state.report is None else state.report.gesture

    async def until(self, condition: Callable[[], object]) -> None:
        """Wait for something to be shown; raises TimeoutError."""
        async with asyncio.timeout(LIMIT_S):
            while not condition():
                await self.pilot.pause(0.05)

    async def keys(self, *keys: str) -> None:
        """Press keys with a moment after each."""
        for key in keys:
            await self.pilot.press(key)
            await self.pilot.pause(0.1)

    def observed(self) -> object:
        """Whether a picture of the hand has come."""
        state = self.app.live_state()
        return state is not None and state.report is not None and state.preview is not None

    async def stand(self) -> None:
        """What a therapist does first: confirm, arm, and the legs to standing."""
        await self.keys("c", "y")
        await self.until(lambda: self.snapshot and self.snapshot.patient_confirmed)
        await self.keys("a")
        await self.until(lambda: self.snapshot and self.snapshot.armed)
        await self.act("0", Action.INITIALISE)
        await self.until(lambda: self.snapshot and self.snapshot.state is GaitState.STANDING)

    async def act(self, key: str, action: Action) -> None:
        """The therapist's action, asked again as a person would while the legs still come to rest."""
        while not (self.snapshot and self.snapshot.action is action):
            await self.until(lambda: self.snapshot and action in self.snapshot.allowed)
            await self._ask(key, action, self.snapshot.refusal_count if self.snapshot else 0)

    async def _ask(self, key: str, action: Action, refused: int) -> None:
        await self.keys("t", key)
        await self.until(lambda: (now := self.snapshot) and (now.action is action or now.refusal_count > refused))

    async def stir(self) -> None:
        """Move the hand until both cameras measure it."""
        async with asyncio.timeout(LIMIT_S):
            while "no measurement" in self.text():
                await self.keys("left", "right")
                await self.pilot.pause(MEASURED_S)

    def text(self) -> str:
        """The text on the screen."""
        return screen_text(self.app)

    async def take(self, name: str) -> None:
        """One picture of what is on the screen."""
        await self.pilot.pause(SETTLE_S)
        FOLDER.mkdir(parents=True, exist_ok=True)
        (FOLDER / f"{name}.svg").write_text(self.app.export_screenshot(title="rleex"), encoding="utf-8")


async def patients(camera: Photographer) -> None:
    """The list, the form and the start of a session."""
    await camera.take("patients")
    await camera.keys("e")
    await camera.take("form")
    await camera.keys("escape", "enter")
    await camera.take("start")


async def training(camera: Photographer) -> None:
    """A wrong finger is named."""
    await camera.keys("t")
    await camera.until(lambda: (state := camera.app.live_state()) and state.report)
    await camera.keys("5")
    await camera.until(lambda: camera.gesture() is Gesture.FIVE)
    await camera.take("training")


async def session(camera: Photographer) -> None:
    """Checks, confirm, arm, stand, walk, stop, acknowledge."""
    await camera.until(lambda: camera.snapshot and camera.observed())
    await camera.keys("s")
    await camera.take("checks")
    await camera.keys("escape", "c")
    await camera.take("confirm")
    await camera.keys("escape")
    await camera.stand()
    await camera.keys("t")
    await camera.take("actions")
    await camera.keys("escape", "5")
    await camera.until(lambda: camera.gesture() is Gesture.FIVE)
    await camera.act("5", Action.WALK)
    await camera.until(lambda: camera.snapshot and camera.snapshot.steps)
    await camera.take("session-200x50")
    await camera.keys("b")
    await camera.take("large")


async def stopped(camera: Photographer) -> None:
    """What the screen says after STOP."""
    await camera.until(lambda: camera.snapshot and camera.observed())
    await camera.stand()
    await camera.act("7", Action.STAIR_UP)
    await camera.until(lambda: camera.snapshot and camera.snapshot.progress > MID_SWING)
    await camera.keys("space")
    await camera.until(lambda: camera.snapshot and camera.snapshot.effect is Effect.HOLD)
    await camera.take("stopped")


async def small(camera: Photographer) -> None:
    """The live screen in the small terminal, and help."""
    await camera.until(lambda: camera.snapshot and camera.observed())
    await camera.stand()
    await camera.keys("8")
    await camera.until(lambda: camera.gesture() is Gesture.EIGHT)
    await camera.take("session-80x24")
    await camera.keys("f1")
    await camera.take("help")


async def compare(camera: Photographer) -> None:
    """The session's camera beside one with depth, before the same hand: a push, then at a ruler's 36 cm."""
    await camera.until(lambda: camera.snapshot and camera.observed())
    await camera.keys("5")
    await camera.until(lambda: camera.gesture() is Gesture.FIVE)
    await camera.keys("v", "2", *SECOND, "enter")
    await camera.until(lambda: "D435i" in camera.text())
    await camera.stir()
    await camera.keys("p")
    await camera.pilot.pause(MEASURED_S)
    await camera.keys("p")
    await camera.stir()
    await camera.keys("r", *"36", "enter")
    await camera.until(lambda: camera.text().count("36.0  digital") == 2)
    await camera.stir()
    await camera.pilot.pause(MEASURED_S)
    across, down = camera.app.size
    await camera.take(f"compare-{across}x{down}")


async def review(camera: Photographer) -> None:
    """The session that was photographed before, as its audit trail tells it."""
    await camera.keys("r", "enter")
    await camera.until(lambda: "checked signature" in camera.text())  # the verdict on its proof
    await camera.keys("n", "n", "n", "n")
    await camera.take("review")


async def replay(camera: Photographer) -> None:
    """A command of that session, from its recording."""
    await camera.keys("r", "enter")
    await camera.until(lambda: "checked signature" in camera.text())
    await camera.keys("end", "r")
    await camera.until(lambda: isinstance(camera.app.screen, ReplayScreen))
    while "walk" not in camera.text():
        await camera.keys("p")
    await camera.keys(*["right"] * STEPS_TO_MID_SWING)
    await camera.take("replay")


SCENES = (
    ("patients", patients, LARGE, False),
    ("training", training, LARGE, False),
    ("session", session, LARGE, True),
    ("review", review, LARGE, False),
    ("replay", replay, LARGE, False),
    ("stopped", stopped, SMALL, True),
    ("small", small, SMALL, True),
    *(("compare", compare, size, True) for size in (SMALL, MIDDLE, LARGE)),
)


def recorded(config: Config) -> Config:
    """With a recording beside the trail."""
    return msgspec.structs.replace(config, recording=RecordingConfig(on=True))


async def photograph(home: Home, config: Config, wanted: list[str]) -> None:
    """Every scene that is wanted, or all, each in a console of its own."""
    console = Console()
    for name, scene, size, live in SCENES:
        if wanted and name not in wanted:
            continue
        console.print(f"{name} …")
        app = ConsoleApp(home, recorded(config) if scene is session else config, profile=DEMO_PATIENT if live else None)
        async with app.run_test(size=size) as pilot:
            try:
                await pilot.pause(SETTLE_S)
                await scene(Photographer(app, pilot))
            finally:
                app.close_live()
    console.print(f"{len(list(FOLDER.glob('*.svg')))} pictures in {FOLDER.relative_to(Path.cwd())}")


def main() -> None:
    """Take all pictures in a home that is thrown away."""
    real = find_home()
    model = set_up_model(real, load_config(real.config))
    with tempfile.TemporaryDirectory() as folder:
        config = Config(model=str(model), idle_lock_s=0)
        asyncio.run(photograph(Home(Path(folder)), config, sys.argv[1:]))


if __name__ == "__main__":
    main()
