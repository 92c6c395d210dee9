"""A link between two computers that is too poor: arming is refused with the figure, gestures too, keys are not."""

from __future__ import annotations

from typing import Any

import pytest

from app.control.diagnostics import LINK_LIMITS
from app.ipc.messages import OperatorKind
from app.ipc.states import Action, Event, LinkQuantity, RequestRefusal
from app.text.catalogue import render
from kgdfa.gesture import Gesture
from logs.reason import key_of
from tests.app.control.causes import link_of, names_in
from tests.app.control.moments import standing

FIELD = {LinkQuantity.UNCERTAINTY: ("uncertainty_ns", 1e6)}


def with_figure(quantity: LinkQuantity, value: float) -> Any:
    name, factor = FIELD.get(quantity, (quantity.value, 1.0))
    return link_of(**{name: value * factor if factor == 1.0 else int(value * factor)})


def test_limits() -> None:
    """Written down a second time: docs/safety.md rests on them."""
    assert {one.value: limit for one, limit in LINK_LIMITS.items()} == {
        "loss": 0.05,
        "round_trip_ms": 100.0,
        "jitter_ms": 30.0,
        "uncertainty_ms": 50.0,
    }


@pytest.mark.parametrize("quantity", LinkQuantity)
def test_arming_is_refused_beyond_a_limit_and_not_at_it(quantity: LinkQuantity) -> None:
    for factor, armed in ((1.0, True), (1.01, False)):
        rig = standing()
        rig.send(OperatorKind.DISARM)
        rig.tick()
        rig.spoil["link"] = with_figure(quantity, LINK_LIMITS[quantity] * factor)
        rig.tick()
        rig.send(OperatorKind.ARM)
        state = rig.tick()
        assert bool(state.armed_ns) is armed
        if not armed:
            assert state.refusal is not None
            assert state.refusal.code == key_of(RequestRefusal.LINK_POOR)
            assert f"{LINK_LIMITS[quantity]:.2f}" in render(state.refusal)


def test_an_armed_gesture_is_refused_and_a_key_is_not() -> None:
    rig = standing()
    rig.spoil["link"] = link_of(loss=0.2)
    state = rig.tick()
    assert Event.LINK_POOR.value in names_in(state)
    rig.release(Gesture.ONE)
    state = rig.tick(20)
    assert state.refusal is not None
    assert state.refusal.code == key_of(Event.LINK_POOR)
    assert state.running is None
    rig.send(OperatorKind.ACT, Action.STEP_RIGHT_FIRST)
    assert rig.tick(3).running is not None


def test_before_the_first_round_trip_nothing_is_armed() -> None:
    rig = standing()
    rig.send(OperatorKind.DISARM)
    rig.tick()
    rig.spoil["link"] = link_of(uncertainty_ns=None)  # type: ignore[arg-type]
    rig.tick()
    rig.send(OperatorKind.ARM)
    assert not rig.tick().armed_ns


def test_the_other_computers_trail_must_not_fail_unseen() -> None:
    from msgspec.structs import replace

    from app.ipc.messages import AuditHealth
    from logs.reason import reason_of

    rig = standing()
    broken = AuditHealth(at_ns=0, written=1, waiting=0, fault=reason_of(OSError("full")))
    rig.spoil["link"] = replace(link_of(), audit=broken)
    assert Event.AUDIT_WRITE_FAILED.value in names_in(rig.tick())
