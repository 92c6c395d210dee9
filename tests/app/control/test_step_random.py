"""Random orders of everything that can happen: no motion that an interlock forbids, whatever the order.

The interlocks are written down here a second time, as what a bystander with a stop-watch would say, without the
table of events.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from app.ipc.messages import OperatorKind
from app.ipc.states import Action, Event, GaitState, Source
from app.motion.follower import Mode
from hal.joints.device import Joint
from hal.joints.protocol import BusFault, DriveFault, DriveState
from kgdfa.gesture import Gesture
from tests.app.control.moments import DAMPING_TICKS, GRANTED, damped, moving, now, resting
from tests.app.control.rig import TICK_NS, Rig

REST_MS = 152  # a hold: 150 ms and the tick that sees it
SETTLE_TICKS = 340  # a joint's timeout, a hold, and half a second more
SILENT_MS = {"alive": 230, "watching": 200, "auditing": 400, "guarding": 250}
ANSWER_MS = 18
UNPOWERED_MS = {"answers": 1_000, "torque": 1_000_000}  # drives are asked less often then, and give none
JITTER_MS = 52  # a stream that stops may have spoken just before
OK = (DriveFault.NONE,) * 4
K = OperatorKind
COMMANDS = ((K.STOP, None), (K.ACKNOWLEDGE, None), (K.TORQUE_OFF, None), (K.ARM, None), (K.ACT, Action.INITIALISE))
PLACES = {
    "unpowered": lambda: resting(GaitState.UNPOWERED),
    "standing": lambda: resting(GaitState.STANDING),
    "sitting": lambda: resting(GaitState.SITTING),
    "between": lambda: resting(GaitState.BETWEEN),
    "moving": moving,
    "damped": damped,
}


class JointDiagnostics(RuleBasedStateMachine):
    """The rig, and a bystander who notes since when what has been wrong (ms that control was not late)."""

    def __init__(self) -> None:
        super().__init__()
        self.rig = Rig()
        self.stopped = False  # a STOP that nobody acknowledged
        self.since: dict[str, int] = {}  # what is wrong, since when
        self.position = np.zeros(4)
        self.number = 0
        self.late_ms = 0  # control itself, in all

    @initialize(place=st.sampled_from(list(PLACES)))
    def initial_state(self, place: str) -> None:
        self.rig = PLACES[place]()
        self._note()

    @rule(ticks=st.integers(1, 120))
    def time_passes(self, ticks: int) -> None:
        for _ in range(ticks):
            self._tick()

    @rule(action=st.sampled_from(Action))
    def therapist_presses_a_key(self, action: Action) -> None:
        self._send(OperatorKind.ACT, action)

    @rule(gesture=st.sampled_from(Gesture), age_ms=st.sampled_from([30.0, 30.0, 30.0, 300.0]))
    def wearer_releases(self, gesture: Gesture, age_ms: float) -> None:
        self.rig.release(gesture, age_ms)
        for _ in range(18):
            self._tick()

    @rule(kind=st.sampled_from([OperatorKind.ARM, OperatorKind.DISARM, OperatorKind.TORQUE_OFF]))
    def operator_says(self, kind: OperatorKind) -> None:
        self._send(kind)

    @rule()
    def operator_stops(self) -> None:
        self.stopped = True
        self._send(OperatorKind.STOP)

    @rule()
    def operator_acknowledges(self) -> None:
        self.stopped = False
        self._send(OperatorKind.ACKNOWLEDGE)

    @rule()
    def another_console_takes_over(self) -> None:
        self.stopped = True
        self.rig.lease += 1
        self.rig._sequence = 0
        self._send(OperatorKind.TAKE_OVER)

    @rule(commands=st.lists(st.sampled_from(COMMANDS), min_size=2, max_size=4), ticks_apart=st.integers(0, 2))
    def several_commands_come_in_one_tick_or_soon_after_another(
        self, commands: list[tuple[OperatorKind, Action | None]], ticks_apart: int
    ) -> None:
        stopped = False  # in this tick: nothing is acknowledged beside it
        for kind, action in commands:
            stopped = kind is K.STOP or (stopped and ticks_apart == 0)
            self.stopped = stopped or (self.stopped and kind is not K.ACKNOWLEDGE)
            self._say(kind, action)
            for _ in range(ticks_apart):
                self._tick()
        self._tick()

    @precondition(lambda self: now(self.rig).streams.powered)
    @rule(ticks=st.sampled_from([0, 1, 1, 2]))  # after one the plan comes
    def damped_joints_are_switched_off_while_a_stand_is_planned(self, ticks: int) -> None:
        for kind in (K.STOP, K.STOP):
            self.stopped = True
            self._send(kind)
        for _ in range(DAMPING_TICKS):
            self._tick()
        self.operator_acknowledges()
        self._send(K.ACT, Action.INITIALISE)
        for _ in range(ticks):
            self._tick()
        self._send(K.TORQUE_OFF)

    @rule(ticks=st.sampled_from([1, 4, 12, 26, 33, 1_000]))
    def control_stalls(self, ticks: int) -> None:
        self.rig.now_ns += ticks * TICK_NS
        self.rig.spoil = {"late_ns": ticks * TICK_NS, "missed_ticks": ticks}
        self.late_ms += ticks * TICK_NS // 1_000_000
        self._tick()

    @precondition(lambda self: "guarding" not in self.since)
    @rule(off=st.booleans())
    def the_guardian_acts(self, off: bool) -> None:
        self.rig.guardian_health = {"acted": True, "off": off}
        for _ in range(JITTER_MS // 2):
            self._tick()
        self.since.setdefault("acted", self.now_ms)

    @precondition(lambda self: "answers" not in self.since)
    @rule(joint=st.sampled_from(Joint), speed_rad_s=st.sampled_from([-1.2, 1.2]), ticks=st.integers(20, 120))
    def a_joint_falls_silent(self, joint: Joint, speed_rad_s: float, ticks: int) -> None:
        """In a movement, where one is granted: the legs are held then, and settle."""
        granted = GRANTED.get(now(self.rig).gait.state, {Action.INITIALISE})  # only for states at rest
        self._send(K.ACT, min(granted, key=lambda action: action.value))
        for _ in range(ticks):
            self._tick()
        moves = now(self.rig).motion.mode is Mode.MOVING
        self.rig.joints.velocity_rad_s = speed_rad_s * np.eye(4)[joint]
        self._tick()
        self.rig.joints.mute |= {joint}
        self.since.setdefault("answers", self.now_ms)
        for _ in range(SETTLE_TICKS if moves else 1):
            self._tick()

    @rule(stream=st.sampled_from(list(SILENT_MS)))
    def a_stream_falls_silent(self, stream: str) -> None:
        setattr(self.rig, stream, False)
        self.since.setdefault(stream, self.now_ms)

    @rule(
        what=st.sampled_from(
            [
                ("faults", (DriveFault.OVER_CURRENT, *OK[1:])),
                ("faults", (*OK[:3], DriveFault.ENCODER)),
                ("bus", BusFault.BUS_OFF),
                ("temperature_c", np.array([30.0, 85.0, 30.0, 30.0])),
                ("torque_nm", np.array([0.0, 0.0, 130.0, 0.0])),
            ]
        )
    )
    def a_drive_fails(self, what: tuple[str, Any]) -> None:
        setattr(self.rig.joints, *what)
        self.since.setdefault("torque" if what[0] == "torque_nm" else "joints", self.now_ms)

    @rule()
    def no_drive_answers(self) -> None:
        self.rig.joints.silent = True
        self.since.setdefault("answers", self.now_ms)

    @precondition(lambda self: self.since)
    @rule()
    def everything_is_mended(self) -> None:
        joints = self.rig.joints
        joints.faults, joints.bus, joints.silent, joints.mute = OK, BusFault.NONE, False, frozenset()
        joints.temperature_c, joints.torque_nm, joints.velocity_rad_s = np.full(4, 30.0), np.zeros(4), np.zeros(4)
        self.rig.guardian_health = {}
        for stream in SILENT_MS:
            setattr(self.rig, stream, True)
        for _ in range(60):
            self._tick()
        self.since = {}

    @rule()
    def perception_restarts(self) -> None:
        self.rig.restart_perception()

    @rule()
    def the_planner_is_slow(self) -> None:
        self.rig.answer_ticks = 30

    @rule()
    def the_drives_lose_power(self) -> None:
        if self.rig.joints.state is DriveState.ENABLED:
            self.rig.joints.state = DriveState.DISABLED
        self._tick()

    @property
    def now_ms(self) -> int:
        """Without what control missed: it had no chance to see or to do anything then."""
        return self.rig.now_ns // 1_000_000 - self.late_ms

    @invariant()
    def the_guard_had_nothing_to_refuse(self) -> None:
        assert self.rig._refusal is None

    @invariant()
    def a_movement_belongs_to_a_powered_state(self) -> None:
        state = self.rig.state
        if state is not None and state.motion.mode in {Mode.MOVING, Mode.HOLDING, Mode.STIFFENING}:
            assert self.rig.joints.state is DriveState.ENABLED or state.streams.powered

    @invariant()
    def torque_off_is_not_kept_for_a_later_damping(self) -> None:
        state = self.rig.state
        assert state is None or not state.torque_off or state.motion.mode is Mode.DAMPED

    @invariant()
    def what_the_guardian_has_damped_is_not_stiff(self) -> None:
        assert "acted" not in self.since or not self.rig.command.stiffness_nm_rad.any()

    def _send(self, kind: OperatorKind, action: Action | None = None) -> None:
        self._say(kind, action)
        self._tick()

    def _say(self, kind: OperatorKind, action: Action | None) -> None:
        """As the console, which is silent from here on only: whatever it sends says that it runs."""
        if "alive" in self.since:
            self.since["alive"] = self.now_ms
        self.rig.send(kind, action)

    def _tick(self) -> None:
        before = self.rig.state
        self.rig.tick()
        self._no_action_that_is_forbidden()
        self._no_motion_that_is_forbidden()
        self._no_damping_for_a_silent_joint()
        assert before is None or self.rig.state is not before
        self._note()

    def _no_action_that_is_forbidden(self) -> None:
        """Nothing new is accepted while something that refuses has lasted long enough to be known."""
        state = self.rig.state
        assert state is not None
        if state.number == self.number:
            return
        running = state.running  # None: it was ended in the tick in which it was granted
        report = state.reports[-1] if running is None else running.ending or running.report
        assert report.number == state.number
        assert state.patient_confirmed
        assert not self.stopped
        assert report.source is Source.THERAPIST or state.armed_ns
        for name, since_ms in self.since.items():
            lasted_ms = self.now_ms - since_ms
            if name == "watching" and report.source is Source.THERAPIST:
                continue
            assert lasted_ms <= self._limit_ms(name) + JITTER_MS, name

    def _limit_ms(self, name: str) -> int:
        """How long something may be wrong before anything follows from it."""
        limits_ms = SILENT_MS if now(self.rig).streams.powered else {**SILENT_MS, **UNPOWERED_MS}
        return limits_ms.get(name, ANSWER_MS)

    def _no_motion_that_is_forbidden(self) -> None:
        """Stiff joints are told another angle only by an action, or within a hold's time after it was stopped."""
        state = self.rig.state
        assert state is not None
        command = self.rig.command
        stiff = command.stiffness_nm_rad.min() > 0 and state.motion.mode is not Mode.STIFFENING
        if not stiff or np.array_equal(command.position_rad, self.position):
            return
        if state.gait.running is None:
            assert state.reports, "the legs moved without any action"
            assert self.rig.now_ns - state.reports[-1].ended_ns <= REST_MS * 1_000_000
            return
        assert not self.stopped
        for name in ("alive", "joints", "torque", "answers", "acted"):
            if name in self.since:
                assert self.now_ms - self.since[name] <= self._limit_ms(name) + JITTER_MS + REST_MS, name

    def _no_damping_for_a_silent_joint(self) -> None:
        """Its last speed is no motion of now, and the wearer may stand on the other leg."""
        new = {one.event for one in now(self.rig).events if one.since_ns == self.rig.now_ns}
        joints, since_ns = self.rig.joints, self.rig.now_ns - ANSWER_MS * 1_000_000
        if Event.UNEXPECTED_MOTION in new:
            assert any(joints.velocity_rad_s[one] for one in Joint if joints.answered[one][0] >= since_ns)

    def _note(self) -> None:
        state = self.rig.state
        assert state is not None
        self.position, self.number = self.rig.command.position_rad, state.number


TestLegs = JointDiagnostics.TestCase
TestLegs.settings = settings(
    max_examples=60, stateful_step_count=10, deadline=None, suppress_health_check=list(HealthCheck)
)
