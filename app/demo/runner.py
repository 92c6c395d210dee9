"""Drives a session through a course: signs with the digital hand, presses, watches what the legs do.

It knows no more than a wearer and a therapist would: it sees the reports and snapshots that the console sees, and
acts through the hand and the therapist's keys.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from app.demo.course import Leg
from app.demo.trial import Trial, moment_of_command
from app.ipc.messages import ActionReport, ControlSnapshot, HandCommand, HandPose, OperatorKind, TriggerReport
from app.ipc.states import ACTION_OF, Action, Effect, GaitState, Outcome
from app.session.host import SessionHost
from app.system.errors import AppError
from app.text.catalogue import render
from logs.reason import Reason

START_S = 30.0  # the hand model's first load on a slow disk
RECOGNITION_S = 6.0
ACCEPTANCE_S = 3.0
ACTION_S = 60.0
GREEN_S = 1.5
GUARDIAN_S = 10.0  # it damps for seconds before it gives the joints back
STILL_S = 1.5  # longer than a swinging leg is slow at its turning point
LOOK_S = 0.01  # three looks a frame; control itself keeps the times that are reported
DONE = {Outcome.COMPLETED, Outcome.STOPPED, Outcome.REFUSED}


class CourseRunner:
    """Runs legs of a course one after the other and keeps account."""

    def __init__(
        self,
        host: SessionHost,
        *,
        click_s: float = 0.6,
        presses: int = 1,
        approach_m: float = 0.0,
        watch: Callable[[str], None] = lambda _: None,
    ) -> None:
        """click_s: press and withdraw within it. presses: how often a press that did nothing is made again.

        approach_m: how much nearer than the digital hand's own place the hand rests.
        """
        self._host = host
        self._click_s = click_s
        self._presses = presses
        self._approach_m = approach_m
        self._watch = watch
        self.snapshot: ControlSnapshot | None = None
        self.report: TriggerReport | None = None
        self.actions: dict[int, ActionReport] = {}
        self._asked: set[int] = set()
        self._steps_before: dict[int, int] = {}
        self._frames: list[int] = []

    def prepare(self) -> None:
        """Wait for control and perception, confirm the patient, arm. Raises AppError when one doesn't come."""
        self._watch("waiting for camera, hand model and drives")
        if not self._until(lambda: self.snapshot is not None and self._perceives(), START_S):
            raise AppError(f"The session did not start within {START_S:.0f} s ({self._who_is_missing()}).")
        self._host.move_hand(HandCommand(move_z_m=-self._approach_m))
        self._host.send(OperatorKind.CONFIRM_PATIENT)
        self._host.send(OperatorKind.ARM)
        if not self._until(lambda: self._now.armed, ACCEPTANCE_S):
            raise AppError(
                f"Control did not arm: {_text(self._now.why_not) or 'no answer'}; see the session's audit trail."
            )

    def run(self, leg: Leg) -> Trial:
        """Sign, press, and wait until the legs have done it (or walked far enough)."""
        action = ACTION_OF[leg.gesture]
        self._watch(f"gesture {leg.gesture.value}: {action.value}")
        start = self._now.state
        self._until(lambda: action in self._now.allowed or self._astray(leg), ACTION_S)
        if action not in self._now.allowed:
            why = f"not allowed: {_text(self._now.why_not)}"
            return self._trial(leg, start, recognised=False, reason=why, interrupted=self._astray(leg))
        self._host.move_hand(HandCommand(gesture=leg.gesture))
        if not self._until(lambda: self._seen(leg), RECOGNITION_S):
            held = self._astray(leg)
            return self._trial(leg, start, recognised=False, reason=self._why_unseen(), interrupted=held)
        return self._press(leg, action, start)

    def relax(self) -> None:
        """Let the hand rest, as a wearer does between gestures."""
        self._host.move_hand(HandCommand(pose=HandPose.REST))
        self._until(lambda: self.report is not None and self.report.gesture is None, RECOGNITION_S)

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
        return off and self._until(lambda: self._now.effect < Effect.HOLD, ACCEPTANCE_S) and self._hang_still()

    def recover(self) -> bool:
        """As a therapist after an interlock held the legs: look, acknowledge; whether they may be brought back.

        Legs that the guardian took are switched off first: it watches again when they are.
        """
        if self._now.effect is Effect.DAMP and self._now.enabled:
            self._host.send(OperatorKind.TORQUE_OFF)
        self._until(lambda: not any(e.present and e.effect >= Effect.HOLD for e in self._now.events), GUARDIAN_S)
        if self._now.effect >= Effect.HOLD:
            self._host.send(OperatorKind.ACKNOWLEDGE)
        return self._until(self._ready_again, ACCEPTANCE_S) and (self._now.enabled or self._hang_still())

    def unintended(self) -> int:
        """Actions that began without having been asked for."""
        return sum(report.number not in self._asked for report in self.actions.values() if report.accepted_ns)

    def perception_fps(self) -> float:
        """Frames a second over the whole run, by their capture times."""
        if len(self._frames) < 2:
            return 0.0
        return (len(self._frames) - 1) / ((self._frames[-1] - self._frames[0]) / 1e9)

    def _press(self, leg: Leg, action: Action, start: GaitState) -> Trial:
        known = set(self.actions)
        number, made, pressed = None, 0, False
        while number is None and made < self._presses:
            made += 1
            pressed = self._click(action, known) if made == 1 else self._push_until_green(action, known)
            number = self._new_action(action, known)
        if number is None:
            why, held = self._why_no_action(pressed), self._astray(leg)
            return self._trial(leg, start, pressed=pressed, presses=made, reason=why, interrupted=held)
        self._asked.add(number)
        self._until(lambda: self._finished(leg, number), ACTION_S)
        report = self.actions[number]
        reached = self._now.state is leg.end or (leg.steps > 0 and report.outcome is Outcome.RUNNING)
        ok = reached and report.outcome is not Outcome.STOPPED and moment_of_command(report) > 0
        reason = "" if ok else f"{report.outcome.value} too early: {_text(report.reason or self._now.why_not)}"
        return self._trial(
            leg, start, pressed=pressed, presses=made, report=report, reason=reason, ok=ok, interrupted=not ok
        )

    def _click(self, action: Action, known: set[int]) -> bool:
        """Press and withdraw once within the click's time; whether the button was released by it."""
        before = self.report.release_count if self.report else 0
        self._host.move_hand(HandCommand(click_s=self._click_s))
        self._until(lambda: self._new_action(action, known) is not None, self._click_s + ACCEPTANCE_S)
        return self.report is not None and self.report.release_count > before

    def _push_until_green(self, action: Action, known: set[int]) -> bool:
        """As people do whose click did nothing: push, wait for the button to turn green, withdraw."""
        before = self.report.release_count if self.report else 0
        self._host.move_hand(HandCommand(press=True))
        self._until(lambda: self.report is not None and self.report.pressed, GREEN_S)
        self._host.move_hand(HandCommand(press=False))
        self._until(lambda: self._new_action(action, known) is not None, ACCEPTANCE_S)
        return self.report is not None and self.report.release_count > before

    def _why_no_action(self, pressed: bool) -> str:
        if pressed:
            return _text(self._now.refusal) or "released, and control did not act"
        if self.report is not None and self.report.cancel_reason:
            return f"not pressed: {_text(self.report.cancel_reason)}"
        return "not pressed: the hand did not come near enough with its gesture"

    def _finished(self, leg: Leg, number: int) -> bool:
        report = self.actions[number]
        if leg.steps:
            return report.outcome in DONE or (self._now.state is leg.end and self._walked(number) >= leg.steps)
        return report.outcome in DONE and self._now.action is None

    def _walked(self, number: int) -> int:
        return self._now.steps - self._steps_before.setdefault(number, self._now.steps)

    def _new_action(self, action: Action, known: set[int]) -> int | None:
        fresh = [r.number for r in self.actions.values() if r.action is action and r.number not in known]
        return max(fresh) if fresh else None

    def _trial(
        self,
        leg: Leg,
        start: GaitState,
        *,
        reason: str,
        recognised: bool = True,
        pressed: bool = False,
        presses: int = 0,
        report: ActionReport | None = None,
        ok: bool = False,
        interrupted: bool = False,
    ) -> Trial:
        return Trial(
            gesture=leg.gesture,
            recognised=recognised,
            pressed=pressed,
            presses=presses,
            start=start,
            end=self._now.state,
            ok=ok,
            reason=reason,
            report=report,
            interrupted=interrupted,
        )

    def _hang_still(self) -> bool:
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

    def _astray(self, leg: Leg) -> bool:
        """Whether waiting is in vain: the legs are held, or rest where this leg does not begin."""
        held = self._now.effect >= Effect.HOLD
        return held or (self._now.action is None and self._now.state is not leg.start)

    @property
    def _now(self) -> ControlSnapshot:
        if self.snapshot is None:
            raise AppError("Control has not spoken yet; prepare the session first.")
        return self.snapshot

    def _perceives(self) -> bool:
        return self.report is not None and not self.report.camera_fault and self.report.detector_ready

    def _seen(self, leg: Leg) -> bool:
        return self.report is not None and self.report.gesture is leg.gesture

    def _why_unseen(self) -> str:
        if self.report is None:
            return "no report"
        return _text(self.report.camera_fault or self.report.explanation) or (
            "no hand found" if not self.report.hand else ""
        )

    def _who_is_missing(self) -> str:
        dead = [status.name for status in self._host.processes() if not status.alive]
        if dead:
            return f"{', '.join(dead)} ended; its last words are in {self._host.setup.home / 'diagnostics'}"
        return "no word from control" if self.snapshot is None else "no picture with a hand detector"

    def _until(self, condition: Callable[[], bool], limit_s: float) -> bool:
        end = time.monotonic() + limit_s
        while time.monotonic() < end:
            self._look()
            if condition():
                return True
            time.sleep(LOOK_S)
        return False

    def _look(self) -> None:
        self._host.heartbeat()
        latest = self._host.poll()
        if latest.report is not None:
            self.report = latest.report
            self._frames.append(latest.report.captured_ns)
        if latest.snapshot is not None:
            self.snapshot = latest.snapshot
            self.actions.update({report.number: report for report in latest.snapshot.reports})


def _text(why: Reason | None) -> str:
    return render(why) if why else ""
