"""A sheet of every screen: three sizes, two themes, two languages (docs/reference/screens.md).

`python tools/screen_sheets.py [NAME…]`, also part of `make pictures`; about two minutes. It is the console itself, with
its own keys, over a host that stands still in the place of a session's processes: so every picture of a screen shows
the same moment. The hand is the digital hand's, drawn on as perception draws. `--shots FOLDER` also keeps each picture.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import msgspec
from rich.progress import track
from textual.pilot import Pilot
from textual.strip import Strip

from app.console.app import ConsoleApp
from app.console.screens.review import ReviewScreen
from app.console.screens.session import SessionScreen
from app.system.config import Config, JointsConfig, SessionSetup
from app.system.paths import Home
from profiles.schema import DEMO_PATIENT
from testing.fake_host import screen_text, strips
from tools.contact_sheets import FONTS, cells_image, save, sheet
from tools.sheet_scenes import NOW_NS, SCENES, Scene, StillHost, furnish

FOLDER = Path(__file__).parent.parent / "docs" / "pictures" / "screens"
SIZES = ((80, 24), (120, 36), (200, 50))
ROWS = (("dark", "en"), ("light", "zh"), ("dark", "zh"), ("light", "en"))
LIMIT_S = 60.0
QUIET_S = 0.25  # without a change: what was asked for is drawn

Shots = dict[tuple[str, str], list[Strip]]


class Studio:
    """One console, and its scene."""

    def __init__(self, app: ConsoleApp, pilot: Pilot[None], hosts: list[StillHost]) -> None:
        self.app, self.pilot, self.hosts = app, pilot, hosts

    async def reach(self, scene: Scene) -> None:
        """The scene's screen. Raises TimeoutError."""
        if scene.live:
            await self.until(lambda: (state := self.app.live_state()) and state.snapshot)
            await self.until(lambda: isinstance(self.app.screen, SessionScreen) and self.app.screen.wearer)
        if scene.review:
            await self.app.push_screen(ReviewScreen(self.app.home, "last"))
        for key in scene.keys:
            await self.pilot.press(key)
            await self.pilot.pause(0.1)
        await self.until(lambda: scene.shows in screen_text(self.app))
        for key in scene.then:
            await self.pilot.press(key)
            await self.pilot.pause(0.1)
        if scene.arrange is not None:
            scene.arrange(self.hosts[-1])
        self.app.screen.set_focus(self.app.screen.focused)

    async def shots(self, *, plays: bool) -> Shots:
        """The screen in every size, theme and language."""
        found: Shots = {}
        for theme, code in ROWS:
            self.app.theme = theme
            await self.app.speak(code)
            if plays:
                self.hosts[-1].again()
                await self.until(lambda: self.hosts[-1].at_rest)
            for size in SIZES:
                await self.pilot.resize_terminal(*size)
                await self.until(lambda size=size: self.drawn() == size)
                self.app.clear_notifications()
                await self.quiet()
                found[f"{theme} {code}", f"{size[0]}x{size[1]}"] = strips(self.app)
        return found

    def drawn(self) -> tuple[int, int]:
        """Columns and rows that are drawn now."""
        lines = strips(self.app)
        return lines[0].cell_length if lines else 0, len(lines)

    async def quiet(self) -> None:
        """Until nothing has changed for a while."""
        before, since_s = "", time.monotonic()
        while time.monotonic() - since_s < QUIET_S:
            await self.pilot.pause(0.05)
            now = screen_text(self.app)
            if now != before:
                before, since_s = now, time.monotonic()

    async def until(self, condition: object) -> None:
        """Raises TimeoutError with what is shown instead."""
        assert callable(condition)
        end_s = time.monotonic() + LIMIT_S
        while not condition():
            await self.pilot.pause(0.05)
            if time.monotonic() > end_s:
                raise TimeoutError(screen_text(self.app))


async def photograph(home: Home, scene: Scene) -> Shots:
    """All pictures of one scene, in a console of its own."""
    hosts: list[StillHost] = []

    def make_host(setup: SessionSetup) -> StillHost:
        hosts.append(StillHost(msgspec.structs.replace(setup, session="S-1")))
        return hosts[-1]

    config = Config(idle_lock_s=0, joints=JointsConfig(kind=scene.joints))
    profile = DEMO_PATIENT if scene.live else None
    app = ConsoleApp(
        home, config, profile=profile, make_host=make_host, clock=lambda: hosts[-1].now_ns if hosts else NOW_NS
    )
    async with app.run_test(size=SIZES[-1]) as pilot:
        try:
            studio = Studio(app, pilot, hosts)
            await studio.reach(scene)
            return await studio.shots(plays=scene.plays)
        finally:
            app.close_live()


def keep(name: str, shots: Shots, folder: Path | None) -> None:
    """The sheet; with a folder also each picture, twice as large."""
    save(sheet(shots), FOLDER / f"{name}.png")
    for (row, column), shot in shots.items() if folder else ():
        assert folder is not None
        folder.mkdir(parents=True, exist_ok=True)
        cells_image(shot, 2).save(folder / f"{name}-{column}-{row.replace(' ', '-')}.png")


def main() -> None:
    """All sheets, or those named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--shots", type=Path, default=None)
    options = parser.parse_args()
    missing = [font for font in FONTS if not Path(font).is_file()]
    if missing:
        parser.error(f"no {', '.join(missing)}: sudo apt-get install fonts-dejavu-core fonts-wqy-microhei")
    with tempfile.TemporaryDirectory() as folder:
        home = Home(Path(folder))
        furnish(home)
        shoot, failed = partial(photograph, home), list[str]()
        for name in track(options.names or list(SCENES), "sheets"):
            try:
                keep(name, asyncio.run(shoot(SCENES[name])), options.shots)
            except TimeoutError as late:
                failed.append(name)
                print(f"{name}: did not come; the screen shows:\n{late}", file=sys.stderr)
    size_mb = sum(path.stat().st_size for path in FOLDER.glob("*.png")) / 1e6
    print(f"{len(list(FOLDER.glob('*.png')))} sheets in {FOLDER}, {size_mb:.1f} MB")
    if failed:
        raise SystemExit(f"missing: {', '.join(failed)}")


if __name__ == "__main__":
    main()
