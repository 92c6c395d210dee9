"""The line on top: patient, operator, hardware or simulation, armed or not, state."""

from __future__ import annotations

from app.console.state import SessionState
from app.console.terms import EFFECT_STYLES, effect_name, state_name
from app.console.widgets.panel import Lines, Part
from app.ipc.messages import ControlSnapshot
from app.ipc.states import Effect
from app.text.catalogue import tr


def describe(state: SessionState) -> Lines:
    """One line."""
    snapshot, config = state.snapshot, state.setup.config
    operator = (f" {state.setup.operator} ", "$text-muted")
    parts = [
        (f" {state.setup.profile.identifier} ", "bold reverse $primary"),
        *((operator,) if state.setup.operator else ()),
        (f" {tr(f'camera.{config.camera.kind}')} · {tr(f'joints.{config.joints.kind}')} ", "$text-muted"),
    ]
    if snapshot is None:
        return ((*parts, (tr("status.starting"), "$text-muted")),)
    parts.append(_arming(snapshot, fresh=state.snapshot_fresh))
    parts.append((f" {state_name(snapshot.state)} ", "bold"))
    if snapshot.effect >= Effect.HOLD:
        parts.append((f" {effect_name(snapshot.effect).upper()} ", EFFECT_STYLES[Effect.DAMP]))
    if not state.snapshot_fresh:
        parts.append((f" {tr('status.silent')} ", EFFECT_STYLES[Effect.DAMP]))
    if snapshot.stop_seen_ns and snapshot.stop_command_ns:
        took_ms = (snapshot.stop_command_ns - snapshot.stop_seen_ns) / 1e6
        parts.append((f" {tr('status.stop_took', ms=f'{took_ms:.0f}')}", "$text-muted"))
    return (tuple(parts),)


def _arming(snapshot: ControlSnapshot, *, fresh: bool) -> Part:
    """Armed gestures stay armed through a STOP or a fault, but none acts until it is over or acknowledged."""
    if not snapshot.armed:
        return f" {tr('status.not_armed')} ", "reverse $warning"
    if snapshot.effect >= Effect.REFUSE or not fresh:
        return f" {tr('status.waits')} ", "reverse $warning"
    return f" {tr('status.armed')} ", "bold reverse $success"
