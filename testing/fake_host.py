"""A host we own: no processes, a control that answers commands well enough to test screens with; and their text."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import msgspec

from app.ipc.messages import (
    AuditHealth,
    GuardianHealth,
    HandCommand,
    OperatorKind,
    PerceptionCommand,
    Preview,
    ProcessStatus,
    TriggerReport,
)
from app.ipc.snapshot import ActionReport, ActiveEvent, ControlSnapshot, RealTime
from app.ipc.states import ACTION_OF, Action, Effect, Event, GaitState, Source
from app.session.latest import Latest
from app.system.config import SessionSetup
from app.system.vocabulary import by_key_only, vocabulary_of
from kgdfa.distance import DistanceSource
from kgdfa.gesture import Decision, Gesture
from kgdfa.press_zone import PressZone
from logs.reason import Reason, reason
from testing.messages import ALLOWED_STANDING, STANDING, event, gradient

if TYPE_CHECKING:
    from textual.app import App
    from textual.strip import Strip


@dataclass
class FakeHost:
    """Answers orders the way control does, at once."""

    setup: SessionSetup
    clock: Callable[[], int] = time.monotonic_ns
    picture: Preview = field(default_factory=gradient)
    sent: list[tuple[OperatorKind, Action | None]] = field(default_factory=list)
    input_ns: list[int | None] = field(default_factory=list)  # of each that was sent: when its key was pressed
    hands: list[HandCommand] = field(default_factory=list)
    perception_commands: list[PerceptionCommand] = field(default_factory=list)
    started: bool = False
    closed: bool = False
    left: bool = False
    beats: int = 0
    state: GaitState = GaitState.UNPOWERED
    effect: Effect = Effect.NOTE
    armed: bool = False
    confirmed: bool = False
    gesture: Gesture | None = None
    pressed: bool = False
    events: tuple[ActiveEvent, ...] = ()
    camera_fault: Reason | None = None
    audit_fault: Reason | None = None
    press_zone: PressZone | None = None
    message: TriggerReport | None = None  # that perception sends; None: as the other fields have it
    walked: dict[str, Any] = field(default_factory=dict)  # fields of control's snapshot: steps, distance, reports
    silent: bool = False
    looking: bool = True  # perception has started
    guardian_gone: bool = False
    unanswered: tuple[str, ...] = ()  # whose drives do not answer the guardian
    switched_off: bool = False  # by the guardian
    rests_at_once: bool = True
    control_ended: bool = False

    @property
    def commands(self) -> bool:
        return self.started or not self.setup.host_pid

    def start(self) -> None:
        self.started = True

    def leave(self) -> None:
        self.left = True

    def close(self) -> None:
        self.closed = True
        shutil.rmtree(self.setup.links, ignore_errors=True)

    def send(self, kind: OperatorKind, action: Action | None = None, *, input_ns: int | None = None) -> int:
        self.sent.append((kind, action))
        self.input_ns.append(input_ns)
        match kind:
            case OperatorKind.STOP | OperatorKind.VOICE_STOP:
                self._stop()
            case OperatorKind.ACKNOWLEDGE:
                self._acknowledge()
            case OperatorKind.ARM | OperatorKind.DISARM:
                self.armed = kind is OperatorKind.ARM
            case OperatorKind.SHUT_DOWN:
                self.control_ended = self.rests_at_once
                self.state = GaitState.UNPOWERED if self.rests_at_once else self.state
            case OperatorKind.CONFIRM_PATIENT:
                self.confirmed = True
        if kind is OperatorKind.ACT and action is Action.INITIALISE:
            self.state = GaitState.STANDING
        return len(self.sent)

    def heartbeat(self) -> None:
        self.beats += 1

    def silence(self) -> None:
        """STOP can't be given any more: nobody asks."""

    def send_to_perception(self, command: HandCommand | PerceptionCommand) -> None:
        if isinstance(command, PerceptionCommand):
            self.perception_commands.append(command)
            return
        self.hands.append(command)
        if isinstance(command.gesture, Gesture):
            self.gesture = command.gesture

    def poll(self) -> Latest:
        now_ns = self.clock()
        acted = bool(self.unanswered) or self.switched_off
        guardian = GuardianHealth(at_ns=now_ns, acted=acted, off=self.switched_off, unanswered=self.unanswered)
        if self.silent or not self.started:
            return Latest(
                snapshot=None,
                report=None,
                preview=None,
                audit=None,
                processes=self._processes(),
                guardian=guardian,
            )
        return Latest(
            snapshot=self._snapshot(now_ns),
            report=self._report(now_ns),
            preview=self.picture,
            audit=AuditHealth(at_ns=now_ns, written=1, waiting=0, fault=self.audit_fault),
            processes=self._processes(),
            guardian=guardian,
        )

    def kinds(self) -> list[OperatorKind]:
        """The orders that came, without their actions."""
        return [kind for kind, _ in self.sent]

    def _stop(self) -> None:
        self.effect = Effect.HOLD if self.effect < Effect.HOLD else Effect.DAMP
        self.state = GaitState.BETWEEN
        self.events = (event(Event.STOP, self.effect, self.clock()),)

    def _acknowledge(self) -> None:
        self.effect, self.events = Effect.NOTE, ()

    def _processes(self) -> tuple[ProcessStatus, ...]:
        names = ("audit", "guardian", "planner", "control", "perception")
        return tuple(
            ProcessStatus(
                name=name,
                pid=os.getpid(),
                alive=self.started
                and not (name == "control" and self.control_ended)
                and not (name == "guardian" and self.guardian_gone),
                restarts=0,
                exit_code=None,
            )
            for name in names
        )

    def _snapshot(self, now_ns: int) -> ControlSnapshot:
        standing = self.state is GaitState.STANDING
        usual = msgspec.structs.replace(
            STANDING,
            at_ns=now_ns,
            state=self.state,
            effect=self.effect,
            armed=self.armed,
            patient_confirmed=self.confirmed,
            enabled=standing,
            allowed=ALLOWED_STANDING if standing else (ACTION_OF[Gesture.ZERO],),
            by_key_only=by_key_only(vocabulary_of(self.setup.profile)),
            events=self.events,
            real_time=RealTime(fifo=True, memory_locked=True, cores_awake=True, core=1),
            report_age_ms=21.0,
        )
        return msgspec.structs.replace(usual, **self.walked)

    def _report(self, now_ns: int) -> TriggerReport:
        if self.message is not None:
            return msgspec.structs.replace(self.message, captured_ns=now_ns, sent_ns=now_ns)
        return TriggerReport(
            incarnation=1,
            sequence=1,
            captured_ns=now_ns,
            sent_ns=now_ns,
            hand=self.gesture is not None,
            gesture=self.gesture,
            raw_gesture=self.gesture,
            confidence=0.93 if self.gesture else 0.0,
            explanation=reason(Decision.NO_HAND) if self.gesture is None else None,
            votes=3 if self.gesture else 0,
            distance_m=0.305,
            distance_source=DistanceSource.MONOCULAR,
            safe_distance_m=0.325,
            distance_sd_m=0.004,
            pressed=self.pressed,
            fps=30.0,
            camera="digital hand",
            detector_ready=self.looking,
            camera_fault=self.camera_fault,
            press_zone=self.press_zone,
        )


def walk_steps(host: FakeHost, steps: int, step_m: float = 0.3, **fields: Any) -> None:
    """Control reports a walk that moves since now, and so many steps in the session."""
    before: tuple[ActionReport, ...] = host.walked.get("reports", ())
    walk = ActionReport(
        number=1,
        action=Action.WALK,
        source=Source.GESTURE,
        from_state=GaitState.STANDING,
        first_motion_ns=before[0].first_motion_ns if before else host.clock(),
    )
    host.walked = {"steps": steps, "distance_walked_m": steps * step_m, "reports": (walk,), **fields}


def strips(app: App[None]) -> list[Strip]:
    """The cells of the screen with their styles, line by line.

    The one look at Textual's compositor: its public way is a picture in SVG, which takes 0.1 s to make.
    """
    return app.screen._compositor.render_strips()


def screen_text(app: App[None]) -> str:
    """The cells of the screen, line by line."""
    return "\n".join(strip.text for strip in strips(app))
