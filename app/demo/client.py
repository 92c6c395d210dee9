"""A session's client as a wearer and a therapist are: polls what the console receives, moves hand and keys."""

from __future__ import annotations

import time
from collections.abc import Callable

from app.demo.drives import DemoFault
from app.ipc.messages import HandCommand, OperatorKind, TriggerReport
from app.ipc.snapshot import ActionReport, ControlSnapshot
from app.ipc.states import Action, Effect, GaitState
from app.session.host import SessionHost
from app.system.errors import AppError
from app.text.catalogue import tr

START_S = 60.0  # imports and the hand model's first load, on a busy machine
ACCEPTANCE_S = 3.0
GUARDIAN_S = 10.0  # it damps for seconds before it gives the joints back
STILL_S = 1.5  # longer than a swinging leg is slow at its turning point
POLL_S = 0.01  # three polls a frame; control itself keeps the times that are reported


class SessionClient:
    """The newest of each stream, and what a therapist does around the actions."""

    def __init__(self, host: SessionHost, *, approach_m: float, watch: Callable[[str], None]) -> None:
        """approach_m: how much nearer than the digital hand's own place the hand rests."""
        self._host = host
        self._approach_m = approach_m
        self._watch = watch
        self.snapshot: ControlSnapshot | None = None
        self.report: TriggerReport | None = None
        self.actions: dict[int, ActionReport] = {}
        self._frames: list[int] = []

    def prepare(self) -> None:
        """Wait for control and perception, confirm the patient, arm. Raises AppError when one doesn't come."""
        self._watch(tr("demo.waiting"))
        if not self._until(lambda: self.snapshot is not None and self._perceives(), START_S):
            raise self._not_started()
        self._host.send_to_perception(HandCommand(move_z_m=-self._approach_m))
        self._host.send(OperatorKind.CONFIRM_PATIENT)
        self._host.send(OperatorKind.ARM)
        if not self._until(lambda: self._now.armed, ACCEPTANCE_S):
            raise AppError(DemoFault.NOT_ARMED, reason=self._now.why_not or "–")

    @property
    def standing(self) -> bool:
        """Whether the legs stand, ready for the next action."""
        return self._now.state is GaitState.STANDING

    @property
    def allowed(self) -> tuple[Action, ...]:
        """What the legs may do now."""
        return self.snapshot.allowed if self.snapshot else ()

    def power_off(self) -> bool:
        """As a therapist takes the power from resting legs: STOP twice, torque off, acknowledge; whether it is off."""
        for kind in (OperatorKind.STOP, OperatorKind.STOP):
            self._host.send(kind)
        if not self._until(lambda: self._now.effect is Effect.DAMP, ACCEPTANCE_S):
            return False
        self._host.send(OperatorKind.TORQUE_OFF)
        off = self._until(lambda: not self._now.enabled, ACCEPTANCE_S)
        self._host.send(OperatorKind.ACKNOWLEDGE)
        return off and self._until(lambda: self._now.effect < Effect.HOLD, ACCEPTANCE_S) and self._settled()

    def recover(self) -> bool:
        """As a therapist after an interlock held the legs: check, acknowledge; whether they may be brought back.

        Legs that the guardian took are switched off first: it watches again when they are.
        """
        if self._now.effect is Effect.DAMP and self._now.enabled:
            self._host.send(OperatorKind.TORQUE_OFF)
        self._until(lambda: not any(e.present and e.effect >= Effect.HOLD for e in self._now.events), GUARDIAN_S)
        if self._now.effect >= Effect.HOLD:
            self._host.send(OperatorKind.ACKNOWLEDGE)
        return self._until(self._ready_again, ACCEPTANCE_S) and (self._now.enabled or self._settled())

    def perception_fps(self) -> float:
        """Frames a second over the whole run, by their capture times."""
        if len(self._frames) < 2:
            return 0.0
        return (len(self._frames) - 1) / ((self._frames[-1] - self._frames[0]) / 1e9)

    def _settled(self) -> bool:
        """Wait as a therapist does: legs let go seem to rest at first, then sink into the harness and swing."""
        since = time.monotonic()

        def still() -> bool:
            nonlocal since
            if Action.INITIALISE not in self._now.allowed:
                since = time.monotonic()
            return time.monotonic() - since > STILL_S

        return self._until(still, GUARDIAN_S)

    def _ready_again(self) -> bool:
        may_go_on = self.standing or Action.INITIALISE in self._now.allowed
        return self._now.effect < Effect.HOLD and may_go_on

    @property
    def _now(self) -> ControlSnapshot:
        if self.snapshot is None:
            raise AppError(DemoFault.NOT_PREPARED)
        return self.snapshot

    def _perceives(self) -> bool:
        return self.report is not None and not self.report.camera_fault and self.report.detector_ready

    def _not_started(self) -> AppError:
        dead = [status.name for status in self._host.processes() if not status.alive]
        if dead:
            folder = self._host.setup.home / "diagnostics"
            return AppError(DemoFault.PROCESSES_ENDED, processes=", ".join(dead), folder=folder)
        fault = DemoFault.CONTROL_SILENT if self.snapshot is None else DemoFault.NO_PICTURE
        return AppError(fault, limit_s=START_S)

    def _until(self, condition: Callable[[], bool], limit_s: float) -> bool:
        end = time.monotonic() + limit_s
        while time.monotonic() < end:
            self._poll()
            if condition():
                return True
            time.sleep(POLL_S)
        return False

    def _poll(self) -> None:
        self._host.heartbeat()
        latest = self._host.poll()
        if latest.report is not None:
            self.report = latest.report
            if latest.report.captured_ns > (self._frames[-1] if self._frames else 0):  # 0: before the first frame
                self._frames.append(latest.report.captured_ns)
        if latest.snapshot is not None:
            self.snapshot = latest.snapshot
            self.actions.update({report.number: report for report in latest.snapshot.reports})
