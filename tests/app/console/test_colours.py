"""The themes before every kind of colour vision, and before none: colours stay apart, and no state hangs on one."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from typing import cast

import msgspec
import pytest
from textual.color import Color
from textual.theme import Theme

from app.console.guidance import Light
from app.console.state import SessionState
from app.console.themes import THEMES
from app.console.widgets.figure import TORQUES
from app.console.widgets.gait import gait_map, signpost
from app.console.widgets.gesture import distance_lines
from app.console.widgets.health import Health, health_lines
from app.console.widgets.panel import Lines
from app.console.widgets.push import MarkKind, Push
from app.console.widgets.replay import MARKS
from app.console.widgets.status import EFFECT_MARKS, event_lines, status_line
from app.console.widgets.timeline import MARKS as TIMELINE_MARKS
from app.ipc.snapshot import Lateness
from app.ipc.states import Action, Effect, Event
from app.text.catalogue import tr, use_language
from testing.messages import event
from tests.app.console.test_sizes import DEVICES, NOW_NS, text_of, with_report, with_snapshot

Triple = tuple[float, float, float]
Matrix = tuple[Triple, Triple, Triple]
# Machado, Oliveira and Fernandes, "A physiologically-based model for simulation of color vision deficiency", IEEE
# TVCG 15 (2009), severity 1.0; for linear RGB.
VISIONS: dict[str, Matrix] = {
    "normal": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "protanopia": ((0.152286, 1.052583, -0.204868), (0.114503, 0.786281, 0.099216), (-0.003882, -0.048116, 1.051998)),
    "deuteranopia": ((0.367322, 0.860646, -0.227968), (0.280085, 0.672501, 0.047413), (-0.01182, 0.04294, 0.968881)),
    "tritanopia": ((1.255528, -0.076749, -0.178779), (-0.078411, 0.930809, 0.147602), (0.004733, 0.691367, 0.3039)),
}
XYZ: Matrix = ((0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505))
WHITE: Triple = (0.95047, 1.0, 1.08883)
APART = 19.5  # CIE 1976 ΔE; 2.3 is just noticed side by side, and states stand apart from each other
READABLE = 4.5  # WCAG 2.2, 1.4.3: contrast of text
STILL_READABLE = 3.0  # of bold text, for who lacks a cone


def times(matrix: Matrix, vector: Triple) -> Triple:
    """Matrix times vector."""
    return cast("Triple", tuple(sum(a * b for a, b in zip(row, vector, strict=True)) for row in matrix))


def xyz_of(colour: str, vision: str) -> Triple:
    """What a colour is to this vision."""
    linear = cast("Triple", tuple(_linear(part / 255) for part in Color.parse(colour).rgb))
    return times(XYZ, cast("Triple", tuple(min(1.0, max(0.0, part)) for part in times(VISIONS[vision], linear))))


def _linear(part: float) -> float:
    return part / 12.92 if part <= 0.04045 else float(((part + 0.055) / 1.055) ** 2.4)


def difference(one: str, other: str, vision: str) -> float:
    """CIE 1976 ΔE."""
    pairs = zip(lab_of(xyz_of(one, vision)), lab_of(xyz_of(other, vision)), strict=True)
    return float(sum((a - b) ** 2 for a, b in pairs) ** 0.5)


def lab_of(xyz: Triple) -> Triple:
    """CIELAB under daylight."""
    x, y, z = (
        t ** (1 / 3) if t > 0.008856 else 7.787 * t + 16 / 116 for t in (a / b for a, b in zip(xyz, WHITE, strict=True))
    )
    return 116 * y - 16, 500 * (x - y), 200 * (y - z)


def contrast(one: str, other: str, vision: str) -> float:
    """As WCAG defines it."""
    low, high = sorted((xyz_of(one, vision)[1], xyz_of(other, vision)[1]))
    return (high + 0.05) / (low + 0.05)


def states_of(theme: Theme) -> dict[str, str]:
    """The colours that repeat a state."""
    colours = {
        "success": theme.success,
        "warning": theme.warning,
        "error": theme.error,
        "primary": theme.primary,
    }
    return {name: colour for name, colour in colours.items() if colour is not None}


def test_the_simulation_confuses_what_people_confuse() -> None:
    assert difference("#52d68a", "#ff5d73", "deuteranopia") < APART < difference("#52d68a", "#ff5d73", "normal")
    assert difference("#ffffff", "#000000", "tritanopia") == pytest.approx(100, abs=0.1)


@pytest.mark.parametrize("vision", VISIONS)
@pytest.mark.parametrize("theme", THEMES, ids=lambda theme: theme.name)
def test_the_colours_of_states_stay_apart(theme: Theme, vision: str) -> None:
    colours = states_of(theme)
    assert len(colours) == 4
    apart = {(a, b): difference(colours[a], colours[b], vision) for a, b in combinations(colours, 2)}
    assert {pair: found for pair, found in apart.items() if found < APART} == {}


@pytest.mark.parametrize("vision", VISIONS)
@pytest.mark.parametrize("theme", THEMES, ids=lambda theme: theme.name)
def test_they_are_readable_on_every_ground(theme: Theme, vision: str) -> None:
    least = READABLE if vision == "normal" else STILL_READABLE
    for ground in (theme.background, theme.surface, theme.panel):
        assert ground is not None
        found = {name: contrast(colour, ground, vision) for name, colour in states_of(theme).items()}
        assert {name: value for name, value in found.items() if value < least} == {}, ground


@pytest.mark.parametrize("vision", VISIONS)
@pytest.mark.parametrize("theme", THEMES, ids=lambda theme: theme.name)
def test_stop_is_readable(theme: Theme, vision: str) -> None:
    stop = theme.variables["stop-background"], theme.variables["stop-foreground"]
    assert contrast(*stop, vision) >= (READABLE if vision == "normal" else STILL_READABLE)


def status(state: SessionState) -> Lines:
    """The status line."""
    return status_line(state, 120, "i")


def one_event(effect: Effect, *, acknowledged: bool = False) -> SessionState:
    """The session with an event of this effect."""
    raised = msgspec.structs.replace(event(Event.STOP, effect, NOW_NS), acknowledged=acknowledged, present=False)
    return with_snapshot(events=(raised,))


def distance(state: SessionState) -> Lines:
    """The panel of the button."""
    return distance_lines(state, 60, 12, Push())


def late(p99_ms: float) -> SessionState:
    """The session with control late by so much."""
    return with_snapshot(lateness=Lateness(p99_ms=p99_ms, max_ms=3.0, missed=0))


# Of each kind of state, what the screen shows of its values.
SHOWN: dict[str, Callable[[], list[Lines]]] = {
    "arming": lambda: [
        status(with_snapshot(armed=True)),
        status(with_snapshot(armed=False)),
        status(with_snapshot(armed=True, effect=Effect.REFUSE)),
    ],
    "effect": lambda: [status(with_snapshot(effect=effect)) for effect in (Effect.NOTE, Effect.HOLD, Effect.DAMP)],
    "event": lambda: [event_lines(one_event(effect)) for effect in Effect],
    "acknowledged": lambda: [event_lines(one_event(Effect.HOLD, acknowledged=known)) for known in (True, False)],
    "button": lambda: [distance(with_report(pressed=pressed)) for pressed in (True, False)],
    "ways": lambda: [
        signpost(with_snapshot(allowed=allowed).snapshot, 60, 8)  # type: ignore[arg-type]
        for allowed in ((Action.WALK,), (Action.SIT_DOWN,), ())
    ],
    "map": lambda: [
        gait_map(with_snapshot(**changes).snapshot, 120)  # type: ignore[arg-type]
        for changes in ({"allowed": ()}, {"allowed": (Action.WALK,)}, {"allowed": (), "action": Action.WALK})
    ],
    "lateness": lambda: [
        tuple(line[:1] for line in health_lines(late(p99_ms), DEVICES, 90) if "99.9" in line[0][0] or "!" in line[0][0])
        for p99_ms in (0.1, 99.9)
    ],
}
MARKS_OF: dict[str, list[str]] = {
    "health": [health.value for health in Health],
    "check": [light.value for light in Light],
    "effect": [*EFFECT_MARKS.values(), "✓"],
    "torque": [mark for _, mark, _ in TORQUES] + ["!"],
    "push": [mark.value for mark in MarkKind],
    "replay": [mark for mark, _ in MARKS.values()],
    "timeline": list(TIMELINE_MARKS.values()),
}


@pytest.mark.parametrize("language", ["en", "zh"])
@pytest.mark.parametrize("name", SHOWN)
def test_no_state_is_told_by_colour_alone(name: str, language: str) -> None:
    use_language(language)
    shown = [text_of(lines) for lines in SHOWN[name]()]
    assert len(set(shown)) == len(shown), shown


@pytest.mark.parametrize("name", MARKS_OF)
def test_each_mark_has_its_own_shape(name: str) -> None:
    assert len(set(MARKS_OF[name])) == len(MARKS_OF[name])


@pytest.mark.parametrize("language", ["en", "zh"])
def test_the_stop_bar_says_what_its_colour_says(language: str) -> None:
    use_language(language)
    texts = [tr("stop.idle"), tr("stop.watching"), tr("stop.ready", key="SPACE")]
    texts += [
        tr(name, key="SPACE", acknowledge="k", torque_off="o") for name in ("stop.held", "stop.damped", "stop.off")
    ]
    assert len(set(texts)) == len(texts)
