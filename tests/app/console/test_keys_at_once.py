"""Keys that are all there before the first one is worked on, as after a stall: each value goes to its own field."""

from __future__ import annotations

import pytest
from textual import events
from textual.widgets import DataTable, Input, Select

from app.console.app import ConsoleApp
from app.console.screens.compare import CompareScreen
from app.console.screens.patient_form import PatientForm
from app.console.screens.signin import SignInDialog
from app.system.config import Config, JointsConfig
from app.system.operators import Role, add_operator, load_store, save_store
from app.system.paths import Home
from tests.app.console.conftest import Console, Opener

pytestmark = pytest.mark.usefixtures("cheap_pins")
PIN = "246810"


def give(app: ConsoleApp, *keys: str) -> None:
    for key in keys:
        app.post_message(events.Key(key, key if len(key) == 1 else None))


async def focuses(open_console: Console, field: str) -> None:
    await open_console.until(lambda: (now := open_console.app.focused) is not None and now.id == field)


async def holds(open_console: Console, wanted: dict[str, str]) -> None:
    """Wait until as much has arrived as was typed, wherever it is; then compare."""
    fields = {field.id: field for field in open_console.app.screen.query(Input) if field.id in wanted}
    length = sum(map(len, wanted.values()))
    await open_console.until(lambda: sum(len(field.value) for field in fields.values()) == length)
    assert {name: field.value for name, field in fields.items()} == wanted


@pytest.mark.parametrize("between", ["tab", "enter"])
async def test_a_pin_is_not_shown_as_the_name(console: Opener, home: Home, between: str) -> None:
    save_store(home.keys, add_operator(load_store(home.keys), "Ada", Role.ENGINEER, PIN))
    async with console(profile=None, config=Config(joints=JointsConfig(kind="can"))) as open_console:
        await open_console.shows("demo")
        await open_console.press("f4")
        await open_console.until(lambda: isinstance(open_console.app.screen, SignInDialog))
        await focuses(open_console, "name")
        give(open_console.app, *"Ada", between, *PIN)
        await holds(open_console, {"name": "Ada", "pin": PIN})


async def test_a_patients_height_is_not_written_into_the_name(console: Opener) -> None:
    """Forwards, over a choice, and back; the field that has the focus again takes what is typed for its old value."""
    async with console(profile=None) as open_console:
        await open_console.shows("demo")
        await open_console.press("n")
        await open_console.until(lambda: isinstance(open_console.app.screen, PatientForm))
        await focuses(open_console, "identifier")
        give(open_console.app, *"Ada", "tab", "tab", *"171", "tab", *"66", "shift+tab", *"158")
        await holds(open_console, {"identifier": "Ada", "stature_m": "158", "mass_kg": "66"})
        assert open_console.app.screen.query_one("#sex", Select).value == "female"


async def test_a_ruler_and_a_camera_keep_apart_and_move_no_hand(console: Opener) -> None:
    """The key that leads into a field is no letter, and the letters behind it are no gestures."""
    async with console() as open_console:
        await open_console.press("v")
        await open_console.until(lambda: isinstance(open_console.app.screen, CompareScreen))
        await open_console.until(lambda: open_console.app.screen.query("#ruler"))
        give(open_console.app, "r", *"32", "shift+tab", *"r2")
        await holds(open_console, {"ruler": "32", "second": "r2"})
        assert open_console.host.hands == []


async def test_a_key_that_the_configuration_gives_to_tab_keeps_it_where_no_field_is(console: Opener) -> None:
    async with console(profile=None, config=Config(keys={"patients.new": "tab"})) as open_console:
        await open_console.shows("demo")
        await open_console.until(lambda: isinstance(open_console.app.focused, DataTable))
        await open_console.press("tab")
        await open_console.until(lambda: isinstance(open_console.app.screen, PatientForm))
