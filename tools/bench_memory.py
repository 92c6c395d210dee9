"""Whether the console's memory grows: an hour's beats as fast as they can be drawn, over the host of the tests.

    python -m tools.bench_memory [--hours 1] [--width 80] [--height 24] [--json FILE]

Every beat brings a new snapshot, report and image, as in a session; gestures, presses, states and events come and go,
and a dialog opens and closes now and then. An hour has 72,000 beats (20 a second; a session's image comes 12 times a
second, here with each beat). Memory is looked at sixty times, after a collection; its slope leaves out the first sixth,
in which caches fill. The bound is 10 MB an hour.
"""

from __future__ import annotations

import asyncio
import gc
import json
import statistics
import sys
import tempfile
from itertools import cycle
from pathlib import Path
from typing import Annotated

import msgspec
import psutil
import typer
from rich.console import Console
from rich.progress import track
from textual.pilot import Pilot

from app.console.app import TICK_S, ConsoleApp
from app.ipc.states import Effect, Event, GaitState
from app.system.config import Config, SessionSetup
from app.system.paths import Home
from kgdfa.gesture import Gesture
from profiles.schema import DEMO_PATIENT
from testing.fake_host import FakeHost
from testing.messages import event, gradient

SAMPLES = 60
WARM_SHARE = 6  # one in so many samples is left out at the start
BOUND_MB = 10.0
YIELD_S = 0.003  # for the widgets to take what a beat brought
DRAWN_EVERY = 20  # beats
DIALOG_EVERY = 200  # beats: ten seconds
SHOWN = Console(file=sys.__stderr__)  # Textual takes sys.stderr
STATES = (GaitState.STANDING, GaitState.RIGHT_FORWARD, GaitState.LEFT_FORWARD, GaitState.SITTING)


def advance(host: FakeHost, beat: int) -> None:
    """What changes from one beat to the next; no two reports are alike for long."""
    host.picture = msgspec.structs.replace(host.picture, sequence=beat, captured_ns=beat)
    host.state = STATES[beat // 60 % len(STATES)]
    host.gesture = (None, *Gesture)[beat // 25 % (1 + len(Gesture))]
    host.pressed = beat // 10 % 4 == 0
    note = event(Event.OVER_TEMPERATURE_WARNING, Effect.NOTE, host.clock(), temperature_c=beat // 100 / 7)
    host.events = (note,) if beat // 50 % 2 else ()


async def hour(app: ConsoleApp, pilot: Pilot[None], hosts: list[FakeHost], beats: int) -> list[float]:
    """MB of the process's own memory, looked at `SAMPLES` times."""
    process = psutil.Process()
    while not hosts or not (state := app.live_state()) or not state.snapshot:
        await pilot.pause(0.01)
    found: list[float] = []
    dialog = cycle(("f1", "escape"))
    for beat in track(range(beats), "beats", console=SHOWN, transient=True, disable=not SHOWN.is_terminal):
        advance(hosts[-1], beat)
        app._tick()
        await asyncio.sleep(YIELD_S)
        if beat % DRAWN_EVERY == 0:
            await pilot.pause()  # until all that was brought is drawn
        if beat % DIALOG_EVERY == 0:
            app.simulate_key(next(dialog))
        if beat % (beats // SAMPLES) == 0:
            await pilot.pause()
            gc.collect()
            found.append(process.memory_full_info().uss / 1e6)
    return found


async def measure(beats: int, size: tuple[int, int]) -> list[float]:
    """Samples of one session's memory."""
    with tempfile.TemporaryDirectory() as folder:
        hosts: list[FakeHost] = []

        def make_host(setup: SessionSetup) -> FakeHost:
            hosts.append(FakeHost(setup, picture=gradient(160, 90)))
            return hosts[-1]

        app = ConsoleApp(Home(Path(folder)), Config(), profile=DEMO_PATIENT, make_host=make_host)
        async with app.run_test(size=size) as pilot:
            try:
                return await hour(app, pilot, hosts, beats)
            finally:
                app.close_live()


def growth_per_sample(samples_mb: list[float]) -> float:
    """MB from one sample to the next, by a straight line; the first sixth, in which caches fill, left out."""
    settled_mb = samples_mb[len(samples_mb) // WARM_SHARE :]
    return statistics.linear_regression(range(len(settled_mb)), settled_mb).slope


def main(
    hours: Annotated[float, typer.Option(min=0.01)] = 1.0,
    width: int = 80,
    height: int = 24,
    json_file: Annotated[Path | None, typer.Option("--json")] = None,
) -> None:
    """Measure, print, and end 1 when it grows by more than the bound."""
    beats = max(SAMPLES, round(hours * 3600 / TICK_S))
    samples_mb = asyncio.run(measure(beats, (width, height)))
    settled_mb = samples_mb[SAMPLES // WARM_SHARE :]
    growth_mb = growth_per_sample(samples_mb) * SAMPLES / hours
    print(f"{beats} beats at {width}×{height}: {samples_mb[0]:.1f} MB at first, then {settled_mb[0]:.1f}, at last")
    print(f"{settled_mb[-1]:.1f} MB; the line through them rises by {growth_mb:.2f} MB an hour (bound {BOUND_MB:.0f})")
    if json_file is not None:
        json_file.write_text(json.dumps({"hours": hours, "looks_mb": samples_mb, "growth_mb_per_h": growth_mb}))
    raise typer.Exit(0 if growth_mb <= BOUND_MB else 1)


if __name__ == "__main__":
    typer.run(main)
