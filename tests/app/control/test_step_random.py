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
from app.ipc.states import Action, GaitState, Source
from app.motion.follower import Mode
from hal.joints.protocol import BusFault, DriveFault, DriveState
from kgdfa.gesture import Gesture
from tests.app.control.moments import resting
from tests.app.control.rig import Rig

REST_MS = 152  # a hold: 150 ms and the tick that sees it
SILENT_MS = {"alive": 230, "watching": 200, "auditing": 400, "guarding": 250}
JITTER_MS = 52  # a stream that stops may have spoken just before
OK = (DriveFault.NONE,) * 4


class JointDiagnostics(RuleBasedStateMachine):
    """The rig, and a bystander who notes since when what has been wrong (ms)."""

    def __init__(self) -> None:
        super().__init__()
        self.rig = Rig()
        self.stopped = False  # a STOP that nobody acknowledged
        self.since: dict[str, int] = {}  # what is wrong, since when
        self.position = np.zeros(4)
        self.number = 0
        self.still_ms = 0

    @initialize(state=st.sampled_from([GaitState.UNPOWERED, GaitState.STANDING, GaitState.SITTING, GaitState.BETWEEN]))
    def initial_state(self, state: GaitState) -> None:
        self.rig = resting(state)
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
                ("silent", True),
                ("temperature_c", np.array([30.0, 85.0, 30.0, 30.0])),
                ("torque_nm", np.array([0.0, 0.0, 130.0, 0.0])),
            ]
        )
    )
    def a_drive_fails(self, what: tuple[str, Any]) -> None:
        setattr(self.rig.joints, *what)
        self.since.setdefault("joints", self.now_ms)

    @precondition(lambda self: self.since)
    @rule()
    def everything_is_mended(self) -> None:
        joints = self.rig.joints
        joints.faults, joints.bus, joints.silent = OK, BusFault.NONE, False
        joints.temperature_c, joints.torque_nm = np.full(4, 30.0), np.zeros(4)
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
        return self.rig.now_ns // 1_000_000

    @invariant()
    def the_guard_had_nothing_to_refuse(self) -> None:
        assert self.rig._refusal is None

    @invariant()
    def a_movement_belongs_to_a_powered_state(self) -> None:
        state = self.rig.state
        if state is not None and state.motion.mode in {Mode.MOVING, Mode.HOLDING, Mode.STIFFENING}:
            assert self.rig.joints.state is DriveState.ENABLED or state.streams.powered

    def _send(self, kind: OperatorKind, action: Action | None = None) -> None:
        """As the console, which is silent from here on only: whatever it sends says that it runs."""
        if "alive" in self.since:
            self.since["alive"] = self.now_ms
        self.rig.send(kind, action)
        self._tick()

    def _tick(self) -> None:
        before = self.rig.state
        self.rig.tick()
        self._no_action_that_is_forbidden()
        self._no_motion_that_is_forbidden()
        assert before is None or self.rig.state is not before
        self._note()

    def _no_action_that_is_forbidden(self) -> None:
        """Nothing new is accepted while something that refuses has lasted long enough to be known."""
        state = self.rig.state
        assert state is not None
        if state.number == self.number:
            return
        running = state.running
        assert running is not None
        report = running.ending or running.report
        assert state.patient_confirmed
        assert not self.stopped
        assert report.source is Source.THERAPIST or state.armed_ns
        for name, since_ms in self.since.items():
            lasted_ms = self.now_ms - since_ms
            if name == "watching" and report.source is Source.THERAPIST:
                continue
            assert lasted_ms <= SILENT_MS.get(name, 18) + JITTER_MS, name

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
            ended_ms = state.reports[-1].ended_ns // 1_000_000
            assert self.now_ms - ended_ms <= REST_MS
            return
        assert not self.stopped
        for name in ("alive", "joints"):
            if name in self.since:
                assert self.now_ms - self.since[name] <= SILENT_MS.get(name, 18) + JITTER_MS + REST_MS, name

    def _note(self) -> None:
        state = self.rig.state
        assert state is not None
        self.position, self.number = self.rig.command.position_rad, state.number


TestLegs = JointDiagnostics.TestCase
TestLegs.settings = settings(
    max_examples=30, stateful_step_count=30, deadline=None, suppress_health_check=list(HealthCheck)
)
