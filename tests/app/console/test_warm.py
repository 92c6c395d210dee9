"""What a session asks of the garbage collector, and that it gives it back."""

from __future__ import annotations

import gc
import subprocess
import sys
import weakref
from collections.abc import Iterator

import pytest
from textual.strip import Strip

from app.console.live import gc_freeze, reduce_gc, restore_gc
from app.console.screens import session
from app.console.widgets.wearer import FigurePanel
from app.system.config import Config
from hal.errors import DeviceFault, HardwareError
from profiles.schema import DEMO_PATIENT, Profile
from testing.fake_host import FakeHost
from tests.app.console.conftest import Opener


class Node:
    """Refers to itself, so that only a collection frees it."""

    def __init__(self) -> None:
        self.me = self


@pytest.fixture(autouse=True)
def as_before() -> Iterator[None]:
    """Nothing is frozen yet; whatever a test does, the next one's garbage is collected."""
    gc.unfreeze()
    yield
    restore_gc()
    gc.freeze()


async def test_no_full_collection_stops_the_heartbeat(console: Opener) -> None:
    full: list[bool] = []

    def collected(phase: str, info: dict[str, int]) -> None:
        if phase == "start" and info["generation"] == 2 and started:
            full.append(True)

    started: list[bool] = []
    gc.callbacks.append(collected)
    start = FakeHost.start

    def starting(host: FakeHost) -> None:
        started.append(True)
        start(host)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(FakeHost, "start", starting)
        try:
            async with console() as open_console:
                await open_console.until(lambda: gc.get_freeze_count() > 0)
                assert started
                assert not full
        finally:
            gc.callbacks.remove(collected)


def test_numpy_comes_after_the_first_paint_and_before_the_first_picture() -> None:
    """Loading it where a picture is drawn stops the event loop."""
    code = (
        "import sys, app.console.app as console\n"
        "assert 'numpy' not in sys.modules\n"
        "console.preload_modules()\n"
        "assert 'app.console.widgets.halfblock' in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_what_signs_comes_with_the_first_signature() -> None:
    """A console without a sign-in needs neither (docs/decisions.md)."""
    code = "import sys, app.console.run; assert not {'cryptography', 'argon2'} & sys.modules.keys()"
    subprocess.run([sys.executable, "-c", code], check=True)


async def test_nothing_is_loaded_for_the_figure_before_there_is_a_snapshot(
    console: Opener, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Profile] = []

    def load(profile: Profile, joints: object) -> None:
        asked.append(profile)
        raise HardwareError(DeviceFault.NO_BODY)

    monkeypatch.setattr(session, "load_wearer", load)
    monkeypatch.setattr(FakeHost, "start", lambda _: None)
    async with console(profile=None) as opened:
        await opened.app.begin_session(DEMO_PATIENT, Config())
        await opened.shows("STOP")
        assert not asked
        opened.host.started = True
        await opened.tells("Simulated joints need a body")
        await opened.shows("NOT ARMED")
        assert len(asked) == 1


def test_what_was_kept_is_let_go_and_collected_as_often_as_before() -> None:
    usual = gc.get_threshold()
    kept = Node()
    gone = weakref.ref(kept)
    reduce_gc()
    assert gc.get_threshold() > usual
    gc_freeze()
    del kept
    gc.collect()
    assert gone() is not None, "kept things are left out of collections"
    restore_gc()
    gc.collect()
    assert gone() is None
    assert gc.get_threshold() == usual


async def test_a_session_gives_the_collector_back(console: Opener) -> None:
    usual = gc.get_threshold()
    async with console() as open_console:
        await open_console.until(lambda: gc.get_freeze_count() > 0)
        assert gc.get_threshold() > usual
        await open_console.app.close_session()
        assert gc.get_threshold() == usual
        assert gc.get_freeze_count() == 0


async def test_a_closed_dialog_leaves_no_drawings_behind(console: Opener) -> None:
    """Textual caches the drawings of a thousand widgets, closed or not."""
    async with console() as open_console:
        await open_console.until(lambda: open_console.app.screen.query_one(FigurePanel).wearer)
        kept = []
        for _ in range(2):
            for _ in range(4):
                await open_console.press("c")
                await open_console.shows("Is this the patient?")
                await open_console.press("n")
                await open_console.until(lambda: len(open_console.app.screen_stack) == 2)
            gc.collect()
            kept.append(sum(isinstance(thing, Strip) for thing in gc.get_objects()))
        assert kept[1] <= kept[0] + 50, "a dialog of this size draws 100 lines"
