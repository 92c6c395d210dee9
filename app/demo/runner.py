"""Runs a scenario in a session: signs with the digital hand, presses, waits for what the legs do.

It knows no more than a wearer and a therapist would: it receives the reports and snapshots that the console receives,
and acts through the hand and the therapist's keys.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from app.demo.client import ACCEPTANCE_S, SessionClient
from app.demo.scenario import Attempt, AttemptFault, Step, moment_of_command
from app.ipc.messages import HandCommand, HandPose, OperatorKind
from app.ipc.states import ACTION_OF, Action, Effect, GaitState, Outcome
from app.session.host import SessionHost
from app.text.catalogue import tr
from logs.reason import Reason, reason

RECOGNITION_S = 6.0
ACTION_S = 60.0
PRESSED_S = 1.5
DONE = {Outcome.COMPLETED, Outcome.STOPPED, Outcome.REFUSED}


class ScenarioRunner(SessionClient):
    """Runs the steps of a scenario, and counts what was requested and what happened."""

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
        super().__init__(host, approach_m=approach_m, watch=watch)
        self.click_s = click_s
        self._presses = presses
        self._requested: set[int] = set()
        self._steps_before: dict[int, int] = {}
        self._cancels = 0  # before the attempt's first push
        self._obstacle: Reason | None = None  # the newest refusal or hint since then

    def run(self, step: Step) -> Attempt:
        """Sign, press, and wait until the legs have done it (or walked far enough).

        A gesture that the patient's vocabulary lacks is not signed: the therapist's key stands in for it.
        """
        action = ACTION_OF[step.gesture]
        self._watch(tr("demo.gesture", gesture=step.gesture.value, action=action))
        start = self._now.state
        self._until(lambda: action in self._now.allowed or self._off_scenario(step), ACTION_S)
        if action not in self._now.allowed:
            why = reason(AttemptFault.NOT_ALLOWED, reason=self._now.why_not or "–")
            return self._attempt(step, start, recognised=False, reason=why, interrupted=self._off_scenario(step))
        if action in self._now.by_key_only:
            return self._by_key(step, action, start)
        self._host.send_to_perception(HandCommand(gesture=step.gesture))
        if not self._until(lambda: self._recognised(step), RECOGNITION_S):
            held = self._off_scenario(step)
            return self._attempt(step, start, recognised=False, reason=self._why_unrecognised(), interrupted=held)
        return self._press(step, action, start)

    def relax(self) -> None:
        """Let the hand rest, as a wearer does between gestures."""
        self._host.send_to_perception(HandCommand(pose=HandPose.REST))
        self._until(lambda: self.report is not None and self.report.gesture is None, RECOGNITION_S)

    def unintended(self) -> int:
        """Actions that began without a request."""
        return sum(report.number not in self._requested for report in self.actions.values() if report.accepted_ns)

    def _press(self, step: Step, action: Action, start: GaitState) -> Attempt:
        known = set(self.actions)
        self._cancels, self._obstacle = self.report.cancel_count if self.report else 0, None
        number, made, pressed = None, 0, False
        while number is None and made < self._presses:
            made += 1
            pressed = self._click(action, known) if made == 1 else self._push_until_pressed(action, known)
            number = self._new_action(action, known)
        if number is None:
            why, held = self._why_no_action(pressed), self._off_scenario(step)
            return self._attempt(step, start, pressed=pressed, presses=made, reason=why, interrupted=held)
        return self._carried_out(step, start, number, pressed=pressed, presses=made)

    def _by_key(self, step: Step, action: Action, start: GaitState) -> Attempt:
        known = set(self.actions)
        self._host.send(OperatorKind.ACT, action)
        self._until(lambda: self._new_action(action, known) is not None, ACCEPTANCE_S)
        number = self._new_action(action, known)
        if number is None:
            why = self._now.refusal or reason(AttemptFault.NO_ACTION)
            held = self._off_scenario(step)
            return self._attempt(step, start, recognised=False, by_key=True, reason=why, interrupted=held)
        return self._carried_out(step, start, number, recognised=False, by_key=True)

    def _carried_out(self, step: Step, start: GaitState, number: int, **given: Any) -> Attempt:
        """Wait for the action's end: what came of it."""
        self._requested.add(number)
        self._until(lambda: self._finished(step, number), ACTION_S)
        report = self.actions[number]
        reached = self._now.state is step.end or (step.steps > 0 and report.outcome is Outcome.RUNNING)
        ok = reached and report.outcome is not Outcome.STOPPED and moment_of_command(report) > 0
        cause = report.reason or self._now.why_not or "–"
        early = None if ok else reason(AttemptFault.ENDED_EARLY, outcome=report.outcome, reason=cause)
        return self._attempt(step, start, report=report, reason=early, ok=ok, interrupted=not ok, **given)

    def _click(self, action: Action, known: set[int]) -> bool:
        """Press and withdraw once within the click's time; whether the button was released by it."""
        before = self.report.release_count if self.report else 0
        self._host.send_to_perception(HandCommand(click_s=self.click_s))
        self._until(lambda: self._new_action(action, known) is not None, self.click_s + ACCEPTANCE_S)
        return self.report is not None and self.report.release_count > before

    def _push_until_pressed(self, action: Action, known: set[int]) -> bool:
        """As people do whose click did nothing: push, wait for the button to turn green, withdraw."""
        before = self.report.release_count if self.report else 0
        self._host.send_to_perception(HandCommand(press=True))
        self._until(lambda: self.report is not None and self.report.pressed, PRESSED_S)
        self._host.send_to_perception(HandCommand(press=False))
        self._until(lambda: self._new_action(action, known) is not None, ACCEPTANCE_S)
        return self.report is not None and self.report.release_count > before

    def _why_no_action(self, pressed: bool) -> Reason:
        if pressed:
            return self._now.refusal or reason(AttemptFault.NO_ACTION)
        why = self._obstacle
        if self.report is not None and self.report.cancel_count > self._cancels:
            why = self.report.cancel_reason
        return reason(AttemptFault.NOT_NEAR_ENOUGH) if why is None else reason(AttemptFault.NOT_PRESSED, reason=why)

    def _poll(self) -> None:
        super()._poll()
        if self.report is not None:
            self._obstacle = self.report.hand_refusal or self.report.press_hint or self._obstacle

    def _finished(self, step: Step, number: int) -> bool:
        report = self.actions[number]
        if step.steps:
            return report.outcome in DONE or (self._now.state is step.end and self._walked(number) >= step.steps)
        return report.outcome in DONE and self._now.action is None

    def _walked(self, number: int) -> int:
        return self._now.steps - self._steps_before.setdefault(number, self._now.steps)

    def _new_action(self, action: Action, known: set[int]) -> int | None:
        fresh = [r.number for r in self.actions.values() if r.action is action and r.number not in known]
        return max(fresh) if fresh else None

    def _attempt(self, step: Step, start: GaitState, **given: Any) -> Attempt:
        usual = {"recognised": True, "pressed": False, "presses": 0, "ok": False, "report": None, "interrupted": False}
        return Attempt(gesture=step.gesture, start=start, end=self._now.state, **(usual | given))

    def _off_scenario(self, step: Step) -> bool:
        """Whether waiting is in vain: the legs are held, or rest where this step does not begin."""
        held = self._now.effect >= Effect.HOLD
        return held or (self._now.action is None and self._now.state is not step.start)

    def _recognised(self, step: Step) -> bool:
        return self.report is not None and self.report.gesture is step.gesture

    def _why_unrecognised(self) -> Reason:
        if self.report is None:
            return reason(AttemptFault.NO_REPORT)
        if not self.report.hand:
            return self.report.camera_fault or reason(AttemptFault.NO_HAND)
        return reason(AttemptFault.NOT_RECOGNISED, reason=self.report.explanation or "–")
