"""Every key in one table a place. `id` is what `keys` in the configuration remaps; its text is in the catalogues."""

from __future__ import annotations

import string
from collections.abc import Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING

from textual.app import App, SystemCommand
from textual.binding import Binding
from textual.keys import Keys
from textual.screen import Screen

from app.console.spoken import Sound
from app.console.themes import THEME_NAMES
from app.ipc.messages import OperatorKind
from app.ipc.states import GESTURE_OF, Action
from app.system.errors import AppError, ConsoleFault
from app.text.catalogue import languages, tr
from kgdfa.gesture import Gesture


def _key(id: str, key: str, action: str, *, show: bool = True, priority: bool = False) -> Binding:  # noqa: A002
    return Binding(key, action, f"bind.{id}", show=show, priority=priority, id=id)


EVERYWHERE = (
    _key("stop", "space", "stop", priority=True, show=False),
    _key("help", "f1", "help", priority=True),
    _key("leave", "ctrl+c", "leave", priority=True, show=False),
    _key("quit", "ctrl+q", "leave", priority=True, show=False),
    _key("lock", "ctrl+l", "lock_console", show=False, priority=True),
    _key("sign_out", "f4", "sign_out", show=False, priority=True),
    _key("theme", "f2", "next_theme", show=False, priority=True),
    _key("language", "f3", "next_language", show=False, priority=True),
)
SESSION = (
    _key("confirm", "c", "confirm_patient"),
    _key("arm", "a", "toggle_armed"),
    _key("acknowledge", "k", "acknowledge"),
    _key("act", "t", "act"),
    _key("torque_off", "o", "torque_off", show=False),
    _key("checks", "s", "checks", show=False),
    _key("health", "i", "health", show=False),
    _key("compare", "v", "compare", show=False),
    _key("pause", "z", "pause_picture", show=False),
    _key("large", "b", "large_letters", show=False),
    _key("pictures", "f", "record_pictures", show=False),
    _key("guided", "g", "guided_test", show=False),
    _key("end", "e", "end_session"),
)
DIGITAL_HAND = (
    _key("hand.click", "enter", "hand_click"),
    _key("hand.press", "p", "hand_press", show=False),
    _key("hand.left", "left", "hand_move(-1,0,0)", show=False),
    _key("hand.right", "right", "hand_move(1,0,0)", show=False),
    _key("hand.up", "up", "hand_move(0,-1,0)", show=False),
    _key("hand.down", "down", "hand_move(0,1,0)", show=False),
    _key("hand.nearer", "plus,equals_sign", "hand_move(0,0,-1)", show=False),
    _key("hand.farther", "minus", "hand_move(0,0,1)", show=False),
    _key("hand.rest", "h", "hand_sign('rest')", show=False),
    _key("hand.none", "n", "hand_sign('none')", show=False),
    *(
        _key(f"hand.{gesture.name.lower()}", gesture.value[0], f"hand_sign('{gesture.value}')", show=False)
        for gesture in Gesture
    ),
)
HAND = (  # where training, enrolment or comparison stand in the session's place: also what the STOP bar names
    _key("acknowledge", "k", "acknowledge", show=False),
    _key("torque_off", "o", "torque_off", show=False),
    *DIGITAL_HAND,
)
PATIENTS = (
    _key("patients.begin", "enter", "begin"),
    _key("patients.new", "n", "new"),
    _key("patients.edit", "e", "edit"),
    _key("patients.duplicate", "d", "duplicate", show=False),
    _key("patients.archive", "a", "archive", show=False),
    _key("patients.history", "h", "history", show=False),
    _key("patients.outcomes", "m", "outcomes", show=False),
    _key("patients.export", "x", "export", show=False),
    _key("patients.import", "i", "import_profile", show=False),
    _key("patients.calibrate", "c", "calibrate", show=False),
    _key("patients.training", "t", "training"),
    _key("patients.vocabulary", "g", "vocabulary", show=False),
    _key("patients.review", "r", "review"),
    _key("patients.order", "s", "order", show=False),
    _key("patients.search", "slash", "go_to('#search')", priority=True),
)
ALL = (*EVERYWHERE, *SESSION, *DIGITAL_HAND, *PATIENTS)

# What screens and dialogs bind themselves, and nobody remaps. The tests compare both with all screens, which can't be
# asked here: some load OpenCV and MCAP, in one and a half seconds.
_MOVES = {"up", "down", "left", "right", "home", "end", "pageup", "pagedown", "plus", "minus", "equals_sign"}
OF_SCREENS = frozenset("0123456789celnpruvy") | _MOVES | {"ctrl+s", "enter", "escape", "f5", "f6", "tab"}
BESIDE_HAND = frozenset({"2", "ctrl+s", "e", "escape", "r", "tab", "v"})  # on the screens that have the keys of HAND

_MODIFIERS = {"alt", "ctrl", "shift", "super", "hyper", "meta"}
# Besides single characters; the comma stands between keys.
_NAMED = {key.value.rpartition("+")[2] for key in Keys} | {"comma"}
_NAMED |= {one.key for one in Binding.make_bindings((sign, "", "") for sign in string.punctuation.replace(",", ""))}

# One key asks for the gesture of an action, on the digital hand as in the therapist's dialog.
GESTURE_KEYS: dict[str, Gesture] = {gesture.value[0]: gesture for gesture in Gesture}
HAND_STEP_M = 0.02
CLICK_S = 0.6  # push and draw back: quick for a person, eighteen pictures for the camera


def check_keymap(keymap: Mapping[str, str]) -> None:
    """Raises AppError when the configuration names a key that isn't there, or one that means something else."""
    _check_names(keymap)
    for place in ((*EVERYWHERE, *SESSION, *DIGITAL_HAND), (*EVERYWHERE, *PATIENTS)):
        taken: dict[str, str] = {}
        for binding in place:
            assert binding.id is not None
            for key in keys_of(binding.id, keymap):
                if key in taken:
                    raise AppError(ConsoleFault.KEY_TAKEN, key=key, first=taken[key], second=binding.id)
                taken[key] = binding.id
    for place, reserved in ((EVERYWHERE, OF_SCREENS), (HAND, BESIDE_HAND), (ALL, {App.COMMAND_PALETTE_BINDING})):
        for binding in place:
            remapped = set(keys_of(str(binding.id), keymap)) - set(binding.key.split(","))
            for key in sorted(remapped & reserved):
                raise AppError(ConsoleFault.KEY_RESERVED, key=key, name=binding.id)


def _check_names(keymap: Mapping[str, str]) -> None:
    known = {binding.id for binding in ALL}
    for name in keymap:
        if name not in known:
            names = ", ".join(sorted(str(item) for item in known))
            raise AppError(ConsoleFault.UNKNOWN_KEY_NAME, name=name, known=names)
        for key in keymap[name].split(","):
            *modifiers, last = key.strip().split("+")
            if not set(modifiers) <= _MODIFIERS or (len(last) != 1 and last not in _NAMED):
                raise AppError(ConsoleFault.NO_SUCH_KEY, key=key.strip(), name=name)


def keys_of(id: str, keymap: Mapping[str, str]) -> tuple[str, ...]:  # noqa: A002 - Textual's own name
    """The keys that do what `id` names, each as a key press names it: `slash` for `/`."""
    default = next(binding.key for binding in ALL if binding.id == id)
    return tuple(one.key for one in Binding.make_bindings([(keymap.get(id, default), "", "")]))


if TYPE_CHECKING:
    from app.console.app import ConsoleApp


def commands(app: ConsoleApp, screen: Screen[object]) -> Iterable[SystemCommand]:
    """The keys of the screen, the twelve actions, themes and languages."""
    for active in screen.active_bindings.values():
        binding = active.binding
        if active.enabled and binding.id is not None:
            where = app if active.node is app else screen
            text = tr("palette.key", key=app.get_key_display(binding))
            yield SystemCommand(binding.description, text, partial(app.run_action, binding.action, where))
    if app.live is not None and not app.read_only:
        for action in Action:
            text = tr("palette.act", gesture=tr(GESTURE_OF[action]))
            yield SystemCommand(tr(action), text, partial(app.command, OperatorKind.ACT, action))
    for theme in THEME_NAMES:
        yield SystemCommand(tr(f"theme.{theme}"), tr("palette.theme"), partial(setattr, app, "theme", theme))
    for sound in Sound:
        yield SystemCommand(tr(sound), tr("palette.sound"), partial(app.switch_sound, sound))
    for code, name in languages().items():
        yield SystemCommand(name, tr("palette.language"), partial(app.call_later, app.speak, code))
