"""Control's state from tick to tick, and the tick that the stages of `step` work on."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from app.control.events.table import RaisedEvents, effect_of
from app.control.gait.machine import Change, Gait, changed
from app.control.inputs import ActionRequest, DriveOrder, Inputs, Outputs, Settings, StreamState
from app.control.running_action import RunningAction
from app.control.silence import Silences
from app.control.stop_inputs import StopInputStates
from app.ipc.snapshot import ActionReport, PauseSummary
from app.ipc.states import Action, Effect, GaitState, PauseCause
from app.motion.follower import Motion
from app.motion.plan import PlanRequest
from hal.joints.device import Joint
from logs import records
from logs.reason import Reason
from logs.records import Body

REPORTS_KEPT = 24


class RunningPause(Struct, frozen=True, kw_only=True):
    """A pause until its cause has gone."""

    cause: PauseCause
    began_ns: int
    action: Action
    state: GaitState
    progress: float


class ControlState(Struct, frozen=True, kw_only=True):
    """Everything that outlives a tick."""

    streams: StreamState
    gait: Gait = Gait()
    motion: Motion = Motion()
    events: RaisedEvents = ()
    silenced: Silences = {}  # those that do not answer in time, or have just begun to
    sunk: frozenset[Joint] = frozenset()  # while they did not answer; until that is acknowledged
    stop_inputs: StopInputStates = ()
    running: RunningAction | None = None
    armed_ns: int = 0  # since when a push counts: arming, or confirmation or acknowledgement after it; 0: not armed
    patient_confirmed: bool = False
    stop_presses: int = 0  # since the last acknowledgement
    press_ns: int = 0  # when the one heard last, or the takeover that counts as one, was sent
    voice_stopped: bool = False  # since the last acknowledgement
    stop_ns: int = 0  # when the newest STOP was sent
    stop_received_ns: int = 0
    stop_command_ns: int = 0  # when the first command after a STOP was written
    newest_stop: tuple[int, int] = (0, 0)  # lease and sequence of the newest STOP
    stop_records: tuple[records.Stop, ...] = ()  # of STOPs whose first joint command is still to be written
    pause: RunningPause | None = None
    recent_pauses: tuple[tuple[int, int], ...] = ()  # begin and end, while they count for the next one
    pauses: PauseSummary = PauseSummary()
    torque_off: bool = False  # commanded by the operator; done once the joints are fully damped
    ending_ns: int = 0  # since when the session is being ended; 0: it is not
    still_since_ns: int = 0  # since when the command has not moved; 0: it moves
    unattended: bool = False  # it is ended because no console came back
    lease: int = 1  # of the console that commands
    operator: str = ""  # who has taken the session over; empty: who began it
    sequence: int = 0  # of that console's newest OperatorCommand
    number: int = 0  # of the newest action
    plan_number: int = 0  # of the newest plan request
    planner_ready: bool = False  # it has answered once
    reports: tuple[ActionReport, ...] = ()
    refusal: Reason | None = None
    refusal_count: int = 0
    steps: int = 0
    distance_walked_m: float = 0.0

    @property
    def effect(self) -> Effect:
        """Of all events in force."""
        return effect_of(self.events)


@dataclass(slots=True, kw_only=True)
class Tick:
    """A tick in progress: only `step` and its stages see it."""

    state: ControlState
    inputs: Inputs
    settings: Settings
    requests: list[ActionRequest] = field(default_factory=list)
    acknowledged_ns: int = 0
    stopped: bool = False  # a STOP came in this tick
    unheld: frozenset[Joint] = frozenset()  # joints that are not held any more, whatever was commanded
    drives: DriveOrder = DriveOrder.NONE
    plan_requests: list[PlanRequest] = field(default_factory=list)
    audit: list[Body] = field(default_factory=list)
    finished: bool = False

    @property
    def now_ns(self) -> int:
        """The tick's time."""
        return self.inputs.now_ns

    def update(self, **changes: Any) -> None:
        """Change fields of the state."""
        self.state = replace(self.state, **changes)

    def show_refusal(self, why: Reason) -> None:
        """Show why something is not done."""
        self.update(refusal=why, refusal_count=self.state.refusal_count + 1)

    def update_reports(self, *reports: ActionReport) -> None:
        """Show these reports in place of older ones of the same number."""
        numbers = {report.number for report in reports}
        older = (report for report in self.state.reports if report.number not in numbers)
        self.update(reports=(*older, *reports)[-REPORTS_KEPT:])

    def change_gait(self, change: Change, action: Action | None = None) -> None:
        """Change the gait, and record it; action: the granted one, with REQUESTED."""
        before = self.state.gait
        gait = changed(before, change, action)
        if gait == before:
            return
        self.audit.append(
            records.GaitChanged(
                change=change.value,
                action=action.value if action else None,
                state=gait.state.value,
                running=gait.running.value if gait.running else None,
                phase=gait.phase.value,
                closing=gait.closing,
            )
        )
        if gait.state is not before.state:
            action = gait.running or before.running
            self.audit.append(
                records.Transition(
                    from_state=before.state.value,
                    to_state=gait.state.value,
                    action=action.value if action else None,
                    number=self.state.number,
                )
            )
        self.update(gait=gait)

    @property
    def in_force(self) -> tuple[str, ...]:
        """The events in force, strongest first, as the trail names them."""
        return tuple(one.event.value for one in self.state.events if one.in_force)

    def outputs(self) -> Outputs:
        """What the loop has to do."""
        return Outputs(
            command=self.state.motion.command,
            unheld=self.unheld,
            drives=self.drives,
            plan_requests=tuple(self.plan_requests),
            audit=tuple(self.audit),
            finished=self.finished,
        )
