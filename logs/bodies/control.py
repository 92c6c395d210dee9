"""What was commanded, refused, planned and done, and the events that came between."""

from __future__ import annotations

from msgspec import Struct

from logs.bodies.values import Measured, Quad


class Command(Struct, frozen=True, kw_only=True, tag_field="kind", tag="command"):
    """An action was accepted; `source` is whose wish it was."""

    number: int
    action: str
    source: str
    state: str
    gesture: str | None = None
    recognised_ns: int = 0
    released_ns: int = 0
    accepted_ns: int = 0


class Refusal(Struct, frozen=True, kw_only=True, tag_field="kind", tag="refusal"):
    """A wish was refused, with the reason that the operator saw."""

    reason: str
    source: str
    state: str = ""
    action: str | None = None
    gesture: str | None = None
    number: int = 0


class GuardRefusal(Struct, frozen=True, kw_only=True, tag_field="kind", tag="guard-refusal"):
    """The guard before the drives refused a joint command."""

    reason: str
    joint: str = ""
    quantity: str = ""
    value: Measured = None
    limit: Measured = None


class PlanChecked(Struct, frozen=True, kw_only=True, tag_field="kind", tag="plan"):
    """A planned motion and the check that it passed or failed as a whole."""

    number: int
    action: str
    phase: str
    ok: bool
    reason: str
    duration_s: float
    peak_speed_rad_s: Quad = (None, None, None, None)
    peak_torque_nm: Quad = (None, None, None, None)
    min_clearance_m: Measured = None
    steps: int = 0
    advance_m: float = 0.0


class Transition(Struct, frozen=True, kw_only=True, tag_field="kind", tag="transition"):
    """The gait state changed."""

    from_state: str
    to_state: str
    action: str | None = None
    number: int = 0


class ActionEnd(Struct, frozen=True, kw_only=True, tag_field="kind", tag="action-end"):
    """An action ended; moments that never came are 0."""

    number: int
    action: str
    source: str
    from_state: str
    to_state: str | None
    outcome: str  # completed, refused, stopped
    reason: str = ""
    recognised_ns: int = 0
    released_ns: int = 0
    accepted_ns: int = 0
    first_command_ns: int = 0
    first_motion_ns: int = 0
    ended_ns: int = 0
    tracking_rms_rad: Measured = None
    steps: int = 0
    distance_m: float = 0.0


class EventRaised(Struct, frozen=True, kw_only=True, tag_field="kind", tag="event-raised"):
    """A row of the table of events came into force."""

    event: str
    effect: str
    text: str


class EventCleared(Struct, frozen=True, kw_only=True, tag_field="kind", tag="event-cleared"):
    """The condition of an event is gone; its effect may stay until acknowledged."""

    event: str
    effect: str
    lasted_s: float = 0.0


class EffectChanged(Struct, frozen=True, kw_only=True, tag_field="kind", tag="effect"):
    """What all active events together do to the legs has changed."""

    from_effect: str
    to_effect: str


class Acknowledgement(Struct, frozen=True, kw_only=True, tag_field="kind", tag="acknowledgement"):
    """The operator acknowledged what was held or damped."""

    events: tuple[str, ...]
    waited_s: float = 0.0  # since the oldest of them was raised
    accepted: bool = True
    reason: str = ""


class Stop(Struct, frozen=True, kw_only=True, tag_field="kind", tag="stop"):
    """STOP was pressed."""

    state: str
    effect: str
    sent_ns: int = 0
    seen_ns: int = 0
    command_ns: int = 0  # first joint command that it changed


class Arming(Struct, frozen=True, kw_only=True, tag_field="kind", tag="arming"):
    """The operator armed or disarmed the device."""

    armed: bool
    reason: str = ""
