"""The engineer's health: one dot with a word, and the page behind it."""

from __future__ import annotations

from enum import Enum

from app.console.guidance import RECORDERS
from app.console.state import SessionState
from app.console.widgets.curves import joint_fault, joint_line
from app.console.widgets.panel import Line, Lines, Part, fitted, plain, wrapped
from app.ipc.messages import LinkHealth
from app.ipc.snapshot import ControlSnapshot
from app.ipc.streams import LINK, NS_PER_MS
from app.text.catalogue import render, tr
from hal.joints.device import Joint, JointDevice

SLOW_MS = 150.0  # a report that is older reaches the legs late
LEAST_FPS = 15.0
LATE_MS = 2.0  # a whole tick


class Health(Enum):
    """How machine and links are: a shape, and a colour that only repeats it."""

    GOOD = "●"
    SLOW = "◐"
    BAD = "✗"


_STYLES = {Health.GOOD: "$success", Health.SLOW: "bold $warning", Health.BAD: "bold $error"}


def health_of(state: SessionState) -> Health:
    """The worst of what the page shows."""
    snapshot, report = state.snapshot, state.report
    if snapshot is None:
        return Health.BAD if state.fault else Health.SLOW
    ended = {process.name for process in state.all_processes if not process.alive}
    unwritten = state.audit is not None and state.audit.fault is not None
    missing = ended - RECORDERS or state.misses_process
    blind = not state.starting if report is None else bool(report.camera_fault) or not state.report_fresh
    if blind or not state.snapshot_fresh or missing or unwritten or any(map(joint_fault, snapshot.joints)):
        return Health.BAD
    late = snapshot.lateness.p99_ms > LATE_MS or snapshot.report_age_ms > SLOW_MS
    slow = report is None or late or report.fps < LEAST_FPS or not snapshot.real_time.fifo
    return Health.SLOW if slow or ended else Health.GOOD


def health_dot(state: SessionState) -> Part:
    """The dot with its word."""
    health = health_of(state)
    return (f" {health.value} {tr(health)} ", _STYLES[health])


def health_lines(state: SessionState, devices: tuple[JointDevice, ...], width: int) -> Lines:
    """Everything behind the dot: camera, control, links and processes, joints."""
    snapshot = state.snapshot
    dot = health_dot(state)
    if snapshot is None:
        return (plain(*dot), plain(tr("health.waiting"), "$foreground-muted"))
    sections = ("health.camera", _camera(state, snapshot)), ("health.control", _control(snapshot))
    lines: list[Line] = [plain(*dot)]
    remote = () if state.link is None else (("health.link", _link(state.link, state.now_ns)),)
    for title, texts in (*sections, *remote, ("health.links", _links(state))):
        lines.append(plain(tr(title), "bold $primary"))
        lines += [plain(f"  {part}", style) for text, style in texts for part in wrapped(text, width - 2)]
    lines.append(plain(tr("panel.joints"), "bold $primary"))
    joints = zip(Joint, snapshot.joints, devices, strict=True)
    lines += [(("  ", ""), *joint_line(joint, now, device, width - 2)) for joint, now, device in joints]
    return tuple(fitted(line, width) for line in lines)


def _camera(state: SessionState, snapshot: ControlSnapshot) -> list[Part]:
    report = state.report
    fps = f"{report.fps:.0f}" if report is not None and state.report_fresh else "–"
    fault = [(render(report.camera_fault), "bold $error")] if report is not None and report.camera_fault else []
    return [(tr("health.chain", fps=fps, age=f"{snapshot.report_age_ms:.0f}"), ""), *fault]


def _control(snapshot: ControlSnapshot) -> list[Part]:
    late = snapshot.lateness
    text = tr("health.ticks", p99=f"{late.p99_ms:.2f}", worst=f"{late.max_ms:.1f}", missed=late.missed)
    slow = late.p99_ms > LATE_MS
    real_time = ("health.fifo", "") if snapshot.real_time.fifo else ("health.no_fifo", "bold $warning")
    return [(f"! {text}" if slow else text, "bold $warning" if slow else ""), (tr(real_time[0]), real_time[1])]


def _link(link: LinkHealth, now_ns: int) -> list[Part]:
    """Round trip, loss and clocks; in words that the other computer does not answer, when it does not."""
    if link.fault is not None:
        return [(render(link.fault), "bold $error")]
    silent = now_ns - link.at_ns > LINK.stale_ms * NS_PER_MS  # the link's process here
    if silent or not link.connected or link.uncertainty_ns is None:
        return [(tr("health.link_lost", host=link.host), "bold $error")]
    quality = tr(
        "health.link_quality",
        host=link.host,
        round_trip=f"{link.round_trip_ms:.1f}",
        jitter=f"{link.jitter_ms:.1f}",
        loss=f"{100 * link.loss:.1f}",
    )
    clocks = tr(
        "health.link_clock",
        offset=f"{link.offset_ns / 1e6:+.1f}",
        uncertainty=f"{link.uncertainty_ns / 1e6:.1f}",
        count=link.steps,
    )
    return [(quality, ""), (clocks, "bold $warning" if link.steps else "")]


def _links(state: SessionState) -> list[Part]:
    found: list[Part] = []
    for process in state.all_processes:
        text = tr("health.process" if process.alive else "health.ended", name=process.name, count=process.restarts)
        found.append((text, "" if process.alive else "bold $error"))
    audit = state.audit
    if audit is not None:
        found.append((tr("health.audit", count=audit.written, waiting=audit.waiting), ""))
        if audit.fault:
            found.append((render(audit.fault), "bold $error"))
    return found
