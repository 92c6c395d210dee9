"""Codes that several processes share: gait states, actions, effects, events, outcomes, refusals."""

from __future__ import annotations

from enum import Enum, IntEnum

from kgdfa.gesture import Gesture


class GaitState(Enum):
    """The paper's eight gait states, and the one that a stop leads to."""

    UNPOWERED = "unpowered"
    STANDING = "standing"
    SITTING = "sitting"
    RIGHT_FORWARD = "right leg forward"
    LEFT_FORWARD = "left leg forward"
    RIGHT_HIGH_STEP = "right leg high step"
    RIGHT_LOW_STEP = "right leg low step"
    RIGHT_OBSTACLE = "right leg obstacle crossing"
    BETWEEN = "between states"  # after a stop in mid-action: only gesture 0 leads out, slowly


class Action(Enum):
    """What the legs can be asked to do, one a gesture (Table 1)."""

    INITIALISE = "initialise"
    STEP_RIGHT_FIRST = "step: right leg starts"
    STEP_LEFT = "step: left leg"
    STEP_RIGHT = "step: right leg"
    STEP_END = "step: close and stand"
    WALK = "walk"
    WALK_END = "end the walk"
    STAIR_UP = "climb a stair"
    STAIR_DOWN = "descend a stair"
    OBSTACLE = "cross an obstacle"
    SIT_DOWN = "sit down"
    STAND_UP = "stand up"


ACTION_OF: dict[Gesture, Action] = {
    Gesture.ZERO: Action.INITIALISE,
    Gesture.ONE: Action.STEP_RIGHT_FIRST,
    Gesture.TWO: Action.STEP_LEFT,
    Gesture.THREE: Action.STEP_RIGHT,
    Gesture.FOUR: Action.STEP_END,
    Gesture.FIVE: Action.WALK,
    Gesture.SIX: Action.WALK_END,
    Gesture.SEVEN: Action.STAIR_UP,
    Gesture.EIGHT: Action.STAIR_DOWN,
    Gesture.NINE: Action.OBSTACLE,
    Gesture.LOVE: Action.SIT_DOWN,
    Gesture.ROCK: Action.STAND_UP,
}
GESTURE_OF: dict[Action, Gesture] = {action: gesture for gesture, action in ACTION_OF.items()}
# Stairs and obstacles are counted as actions: their steps are a crossing's, not a gait's.
LEVEL_WALKING = frozenset(
    {Action.STEP_RIGHT_FIRST, Action.STEP_LEFT, Action.STEP_RIGHT, Action.STEP_END, Action.WALK, Action.WALK_END}
)


class Effect(IntEnum):
    """What an event does to the legs; the strongest of those active wins."""

    NOTE = 0
    REFUSE = 1  # no new action, a walk ends with its running step
    PAUSE = 2  # no new action; slow down along the path within 150 ms, go on by itself when the cause has gone
    HOLD = 3  # slow down along the path within 150 ms, stay there stiffly
    DAMP = 4  # pure damping, ramped from the last command


class Event(Enum):
    """What can forbid or stop motion: the rows of control's table of events. The value stands in the audit trail."""

    __hash__ = object.__hash__  # of the one member itself: Enum's own is Python, asked thirty times a tick

    STOP = "stop"
    STOP_AGAIN = "stop-again"
    VOICE_STOP = "voice-stop"
    HARDWIRED_STOP = "hardwired-stop"
    HARDWIRED_STOP_SANK = "hardwired-stop-sank"
    WEARER_STOP = "wearer-stop"
    THERAPIST_STOP = "therapist-stop"
    STOP_INPUT_UNPRESSED = "stop-input-unpressed"
    SHUTTING_DOWN = "shutting-down"
    SHUTDOWN_DAMPING = "shutdown-damping"
    NOT_ARMED = "not-armed"
    NO_PATIENT = "no-patient"
    NO_PREFLIGHT = "no-preflight"
    NOT_HOMED = "not-homed"
    LEGS_MOVING = "legs-moving"
    FAR_FROM_POSE = "far-from-pose"
    CAMERA_STALE = "camera-stale"
    PERCEPTION_TIMEOUT = "perception-timeout"
    PERCEPTION_STARTING = "perception-starting"
    CONSOLE_TIMEOUT = "console-timeout"
    AUDIT_BACKLOG = "audit-backlog"
    AUDIT_QUEUE_FULL = "audit-queue-full"
    AUDIT_TIMEOUT = "audit-timeout"
    AUDIT_WRITE_FAILED = "audit-write-failed"
    TICK_LATE = "tick-late"
    CONTROL_LATE = "control-late"
    CONTROL_STALLED = "control-stalled"
    STOP_INPUTS_LATE = "stop-inputs-late"
    HOST_SUSPENDED = "host-suspended"
    CLOCK_JUMP = "clock-jump"
    JOINT_TIMEOUT = "joint-timeout"
    JOINT_SANK = "joint-sank"
    DRIVE_FAULT = "drive-fault"
    DRIVE_UNTRUSTED = "drive-untrusted"
    DRIVES_POWER_LOST = "drives-power-lost"
    DRIVE_ORDER_FAILED = "drive-order-failed"
    OVER_TEMPERATURE_WARNING = "over-temperature-warning"
    OVER_TEMPERATURE = "over-temperature"
    FOLLOWING_WARNING = "following-warning"
    FOLLOWING_LIMIT = "following-limit"
    OUT_OF_RANGE = "out-of-range"
    OVER_SPEED = "over-speed"
    OVER_TORQUE = "over-torque"
    GUARD_REFUSAL = "guard-refusal"
    BUS_FAULT = "bus-fault"
    BUS_ERRORS = "bus-errors"
    UNEXPECTED_MOTION = "unexpected-motion"
    GUARDIAN_TIMEOUT = "guardian-timeout"
    GUARDIAN_ACTED = "guardian-acted"
    PLANNER_STARTING = "planner-starting"
    PLANNER_TIMEOUT = "planner-timeout"
    NEXT_STEP_MISSING = "next-step-missing"
    PAUSE_TOO_LONG = "pause-too-long"
    MESSAGE_REJECTED = "message-rejected"
    FOREIGN_PEER = "foreign-peer"
    LINK_POOR = "link-poor"


class PauseCause(Enum):
    """The events that pause, by their shorter wording."""

    CONSOLE_TIMEOUT = Event.CONSOLE_TIMEOUT.value
    CONTROL_LATE = Event.CONTROL_LATE.value
    STOP_INPUTS_LATE = Event.STOP_INPUTS_LATE.value
    NEXT_STEP_MISSING = Event.NEXT_STEP_MISSING.value


class Outcome(Enum):
    """What became of an accepted action."""

    RUNNING = "running"
    COMPLETED = "completed"
    REFUSED = "refused"  # its plan was not possible, or no plan came
    STOPPED = "stopped"


class RequestRefusal(Enum):
    """Why control refuses a request that no event forbids; values of each are in the catalogue's message."""

    COMING_TO_REST = "coming-to-rest"
    RELEASED_BEFORE_ARMING = "released-before-arming"
    RELEASE_EXPIRED = "release-expired"
    KEY_EXPIRED = "key-expired"
    NOT_IN_VOCABULARY = "not-in-vocabulary"  # gesture
    TORQUE_OFF_NEEDS_DAMPING = "torque-off-needs-damping"
    NO_WALK = "no-walk"
    UNPOWERED = "unpowered"
    BETWEEN_STATES = "between-states"
    WRONG_STATE = "wrong-state"
    ACTION_RUNNING = "action-running"
    PLANNER_TIMEOUT = "planner-timeout"
    ENABLE_TIMEOUT = "enable-timeout"
    TORQUE_OFF = "torque-off"
    NOTHING_TO_ACKNOWLEDGE = "nothing-to-acknowledge"
    STOPPED_MEANWHILE = "stopped-meanwhile"
    LINK_POOR = "link-poor"  # quantity, value, limit


class LinkQuantity(Enum):
    """A figure of the link between two computers; its unit in its name."""

    LOSS = "loss"
    ROUND_TRIP = "round_trip_ms"
    JITTER = "jitter_ms"
    UNCERTAINTY = "uncertainty_ms"


class ConsoleChange(Enum):
    """What control records about who commands."""

    TAKEN_OVER = "taken-over"  # operator, lease
    NOBODY_CAME = "nobody-came"


class StopSource(Enum):
    """What a STOP came from; a button's is its own event."""

    KEY = "key"
    VOICE = "voice"
    TAKEOVER = "takeover"


class Source(Enum):
    """Who requested an action."""

    GESTURE = "gesture"
    THERAPIST = "therapist"
