"""A session as a test or tool sees it: the newest message of each of its processes, and a therapist's keys."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable

from app.ipc import streams
from app.ipc.links import LatestReceiver, address
from app.ipc.messages import GuardianHealth, Heartbeat, OperatorKind, TriggerReport
from app.ipc.snapshot import ControlSnapshot
from app.ipc.states import Action, Effect, GaitState

TIMEOUT_S = 60.0  # a limit, not a measure: loading on a busy machine takes its time
KEY_NS = 500_000_000  # a key that did nothing is pressed again after this


class WatchedSession(ABC):
    """The newest message of every process of a session, from its links."""

    def __init__(self, links: streams.LinkDirectory) -> None:
        self._snapshots = LatestReceiver(address(links, streams.SNAPSHOT.name), ControlSnapshot)
        self._heartbeats = LatestReceiver(address(links, streams.HEARTBEAT.name), Heartbeat)
        self._guardian = LatestReceiver(address(links, streams.GUARDIAN.name), GuardianHealth)
        self._reports = LatestReceiver(address(links, streams.TRIGGER.name), TriggerReport)
        self.snapshot: ControlSnapshot | None = None
        self.heartbeat: Heartbeat | None = None
        self.guardian: GuardianHealth | None = None
        self.effects: list[tuple[int, str]] = []  # when the effect became another one
        self._pressed_ns = 0  # when the last key was
        self._steps_before = 0  # the walk that runs
        self.first_report: TriggerReport | None = None
        self.report: TriggerReport | None = None

    @abstractmethod
    def send(self, kind: OperatorKind, action: Action | None = None) -> None:
        """Send an operator command."""

    def close_links(self) -> None:
        """Close the links."""
        for link in (self._snapshots, self._heartbeats, self._guardian, self._reports):
            link.close()

    def poll(self, wait_s: float = 0.02) -> None:
        """Receive the newest message of every stream."""
        self.heartbeat = self._heartbeats.receive() or self.heartbeat
        self.guardian = self._guardian.receive() or self.guardian
        report = self._reports.receive()
        if report is not None:
            self.report, self.first_report = report, self.first_report or report
        snapshot = self._snapshots.receive(wait_s)
        if snapshot is not None:
            self.snapshot = snapshot
            name = snapshot.effect.name
            if not self.effects or self.effects[-1][1] != name:
                self.effects.append((snapshot.at_ns, name))

    @property
    def now(self) -> ControlSnapshot:
        """The newest snapshot, once one has come."""
        assert self.snapshot is not None
        return self.snapshot

    def perception_fps(self) -> float:
        """Frames a second that perception has judged since its first report, by their capture; 0 without perception."""
        first, last = self.first_report, self.report
        if first is None or last is None or last.captured_ns <= first.captured_ns:
            return 0.0
        return (last.sequence - first.sequence) / ((last.captured_ns - first.captured_ns) / 1e9)

    def until(self, wanted: Callable[[ControlSnapshot], bool], what: str = "") -> ControlSnapshot:
        """Poll until control's snapshot fulfils it. Raises TimeoutError naming what did not come."""
        deadline = time.monotonic() + TIMEOUT_S
        while time.monotonic() < deadline:
            self.poll()
            if self.snapshot is not None and wanted(self.snapshot):
                return self.snapshot
        raise TimeoutError(f"{what or 'what was waited for'} did not come; {self.snapshot}")

    def stand(self) -> ControlSnapshot:
        """Confirm, and bring the legs to standing by the therapist's keys, again after each hold."""
        self.send(OperatorKind.CONFIRM_PATIENT)
        return self.until(self.towards_standing, "standing")

    def walk(self, steps: int = 2) -> ControlSnapshot:
        """Stand, and walk at least so many steps at one go, again after each hold."""
        self.stand()

        def towards(now: ControlSnapshot) -> bool:
            if now.action is Action.WALK:
                return now.steps - self._steps_before >= steps
            if self.towards_standing(now) and Action.WALK in now.allowed:
                self._steps_before = now.steps
                self._press(now, OperatorKind.ACT, Action.WALK)
            return False

        return self.until(towards, "walking")

    def damped_since(self, since_ns: int) -> bool:
        """Whether the legs were damped, as by a guardian whose control the host keeps waiting: their pose is lost."""
        return any(at_ns >= since_ns and name == Effect.DAMP.name for at_ns, name in self.effects)

    def settle(self) -> ControlSnapshot:
        """Acknowledge whatever holds the legs, until actions are allowed again."""
        return self.until(lambda now: not self._recovers(now) and now.action is None and bool(now.allowed), "rest")

    def _recovers(self, now: ControlSnapshot) -> bool:
        """Whether the legs are still held; then the key that a therapist would press next is pressed."""
        if now.effect is Effect.DAMP and now.enabled:  # the guardian took them: it watches again when they are off
            self._press(now, OperatorKind.TORQUE_OFF)
        elif now.action is None and now.effect >= Effect.HOLD:
            self._press(now, OperatorKind.ACKNOWLEDGE)
        return now.effect >= Effect.HOLD

    def towards_standing(self, now: ControlSnapshot) -> bool:
        """Whether the legs stand; else the key that a therapist would press next is pressed."""
        if self._recovers(now):
            return False
        if now.state is GaitState.STANDING and now.action is None:
            return True
        if now.action is None and Action.INITIALISE in now.allowed:
            self._press(now, OperatorKind.ACT, Action.INITIALISE)
        return False

    def _press(self, now: ControlSnapshot, kind: OperatorKind, action: Action | None = None) -> None:
        """A key, once in a while."""
        if now.at_ns - self._pressed_ns > KEY_NS:
            self._pressed_ns = now.at_ns
            self.send(kind, action)
