"""The application's session, if it has one: what its screens ask of it and send to it, and its end."""

from __future__ import annotations

import asyncio

from app.console.live import Clock, GuidedTests, Host, HostFactory, LiveSession
from app.console.operator import SignedInApp
from app.console.screens.base import USER_ERRORS
from app.console.state import SessionState
from app.console.stop import StopSwitch
from app.ipc.messages import OperatorKind, PerceptionCommand
from app.ipc.states import Action
from app.outcomes.guided import GuidedStop
from app.session.host import END_S, START_S
from app.system.config import Config, SessionSetup
from app.system.errors import AppError, ConsoleFault
from app.system.paths import Home
from app.text.catalogue import render, tr
from app.text.recorded import result_text
from logs.records import GuidedTestResult


class SessionApp(SignedInApp):
    """At most one session, STOP's switch, and the guided tests."""

    def __init__(self, home: Home, config: Config, make_host: HostFactory, clock: Clock, *, read_only: bool) -> None:
        super().__init__(home, config, read_only=read_only)
        self.switch = StopSwitch()
        self.live: LiveSession | None = None
        self.left_held = False  # this console ended without having taken the session over
        self.guided = GuidedTests(self.trail.emit)
        self.input_ns: int | None = None  # when the input that is handled was given (monotonic); None: nobody dated it
        self._ending_held = False  # a training or an enrolment that was left held
        self._make_host = make_host
        self._clock = clock

    def live_state(self) -> SessionState | None:
        """The session's newest state; None without a session."""
        return None if self.live is None else self.live.state

    def live_session(self) -> LiveSession:
        """The session. Raises AppError without one."""
        if self.live is None:
            raise AppError(ConsoleFault.NO_SESSION)
        return self.live

    def command(self, kind: OperatorKind, action: Action | None = None) -> None:
        """Send an order of the operator's, as of the moment of its key; to none once the session has ended."""
        if self.live is not None:
            self.live.host.send(kind, action, input_ns=self.input_ns)

    def tell_perception(self, command: PerceptionCommand) -> None:
        """To the session's camera; to none once the session has ended: what its screens asked for may come later."""
        if self.live is not None:
            self.live.host.send_to_perception(command)

    def live_setup(self) -> SessionSetup:
        """What the session was started with. Raises AppError without one."""
        return self.live_session().host.setup

    @property
    def has_digital_hand(self) -> bool:
        """Whether keys move a hand."""
        return self.live is not None and self.live.host.setup.config.camera.kind == "digital-hand"

    def tell_result(self, result: GuidedTestResult | None) -> None:
        """Of a guided test that has just ended, if one has."""
        if result is not None:
            self.notify(result_text(result), timeout=20, markup=False)

    def powered(self) -> bool:
        """Whether the drives carry the patient until the session's end; a dead control's only where the guardian acts.

        Once control has ended its last snapshot says nothing of them.
        """
        state = self.live_state() if self.switch.live else None
        if state is None or state.snapshot is None:
            return False
        return state.left_on and not state.abandoned if state.control_ended else state.snapshot.enabled

    def close_live(self) -> None:
        """End the session's processes, if there are any; may take seconds."""
        live, self.live = self.live, None
        if live is not None:
            self.left_held = not live.host.commands
            self.switch.left_on = live.state.left_on
            self._close_trail()
            live.close()

    def leave_live(self) -> None:
        """Leave the session, held: the console ends and its session stays, for another console."""
        live, self.live = self.live, None
        if live is not None:
            self._close_trail()
            live.leave()

    def _close_trail(self) -> None:
        """With the result of a guided test that runs."""
        self.guided.stop(GuidedStop.SESSION_ENDED)
        self.trail.close()

    def _live_of(self, setup: SessionSetup) -> LiveSession:
        """A session, new or running, that STOP reaches."""
        self.guided.clear()
        self.switch.left_on = False  # a session takes the torque off when it starts
        live = self.live = LiveSession(self._make_host(setup), None if self.read_only else self.switch, self._clock)
        return live

    async def _end_held(self, host: Host) -> None:
        """Its commands count from the takeover on; nothing begins before its processes have left camera and legs."""

        def end() -> None:
            try:
                host.start()
            finally:
                host.close()

        fault = ""
        try:
            await asyncio.to_thread(end)
        except USER_ERRORS as error:
            fault = render(error)
        self._ending_held = False
        self.clear_notifications()  # that it is being ended
        if fault:
            self.notify(fault, severity="error", timeout=15, markup=False)

    def _notify_ending(self) -> None:
        self.notify(tr("take_over.ending"), timeout=START_S + END_S)

    def refuse_while_ending(self) -> bool:
        """Say so while the processes of what was left held may have camera and legs."""
        if self._ending_held:
            self._notify_ending()
        return self._ending_held
