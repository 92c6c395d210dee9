"""The checks before arming, as a list that turns green one by one, each failure with its remedy."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import ClassVar

import msgspec
from textual.binding import BindingType

from app.console.screens.checks import Light, results
from app.console.screens.dialogs import Lists
from app.console.screens.preflight import Preflight
from app.console.state import SessionState
from app.console.widgets.distance import zone_words
from app.console.widgets.panel import Lines
from app.system.operators import Permission
from app.text.catalogue import tr
from logs.records import Note

_STYLES = {
    Light.GREEN: "bold $success",
    Light.WAITING: "$text-muted",
    Light.AMBER: "bold $warning",
    Light.RED: "bold $error",
}


def describe(state: SessionState) -> Lines:
    """Two lines a check that is not green, one that is."""
    lines: list[tuple[tuple[str, str], ...]] = []
    for result in results(state):
        lines.append(((f" {result.light.value} ", _STYLES[result.light]), (tr(f"check.{result.name}.name"), "bold")))
        if result.light is not Light.GREEN:
            lines.append(((f"   {tr(f'check.{result.name}.remedy')}", "$text-muted"),))
    zone = None if state.report is None else state.report.press_zone
    if zone is not None:
        lines.append(((f" {zone_words(zone)}", "$text-muted"),))
    if state.fault:
        lines.append(((state.fault, "bold $error"),))
    return tuple(lines)


class Checklist(Lists):
    """Closed with Escape; stays true while it is open. What the console can mend itself is a key away."""

    HELP_PAGE = "checks"
    BINDINGS: ClassVar[list[BindingType]] = [
        ("u", "use_threshold", "bind.checklist.use_threshold"),
        ("p", "preflight", "bind.checklist.preflight"),
    ]

    def title_and_words(self) -> tuple[str, str]:
        """In the language of now."""
        return tr("checks.title"), tr("checks.words")

    def lines_of(self, state: SessionState | None) -> Lines:
        """Every check as it stands."""
        return () if state is None else describe(state)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:  # noqa: ARG002
        """Rehearsals are for real joints; an observer changes nothing."""
        live = self.console_app.live
        if action == "preflight":
            real = live is not None and live.host.setup.config.joints.kind != "simulated"
            return real and not self.console_app.read_only
        return action != "use_threshold" or not self.console_app.read_only

    def action_preflight(self) -> None:
        """Rehearse every action for this patient."""
        setup = self.console_app.live_setup()
        self.app.push_screen(Preflight(setup.profile, setup.config))

    async def action_use_threshold(self) -> None:
        """Put the threshold that suits this camera into the profile."""
        state = self.console_app.live_state()
        report = None if state is None else state.report
        if state is None or report is None or report.press_zone is None or not report.press_zone.possible:
            self.notify(tr("checks.no_threshold"), severity="warning")
            return
        threshold_m, camera = report.press_zone.threshold_m, report.camera

        async def adopt() -> None:
            with self.told():
                self._adopt(state, threshold_m, camera)

        await self.console_app.permitted(Permission.CALIBRATE, adopt)

    def _adopt(self, state: SessionState, threshold_m: float, camera: str) -> None:
        app, name = self.console_app, state.setup.profile.identifier
        now = app.store.load(name)
        if abs(now.press_threshold_m - threshold_m) < 1e-9:
            self.notify(tr("checks.threshold_kept", cm=f"{threshold_m * 100:.0f}"))
            return
        changed = msgspec.structs.replace(now, press_threshold_m=threshold_m)
        app.store.save(changed, by=app.operator, at=datetime.now(UTC), why=f"press zone of {camera}")
        app.trail.emit(Note(text=f"press threshold of {name} set to {threshold_m:.2f} m for {camera}"))
        self.notify(tr("checks.threshold_set", cm=f"{threshold_m * 100:.0f}"))
