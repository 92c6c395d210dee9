"""rleex camera compare: two cameras before one hand, each in a process of its own, without a session."""

from __future__ import annotations

import select
import sys
import time
from collections.abc import Callable
from pathlib import Path

import msgspec
from rich.console import Console
from rich.live import Live
from rich.table import Table

from app.evaluate.harness import decorate, figure, writing
from app.ipc.streams import LinkDirectory
from app.perception.comparison import Comparison
from app.perception.look import CameraSample, Looker, parse_camera, refuse_same_device
from app.system.config import CameraConfig, Config, SessionSetup, load_config
from app.system.paths import Home
from app.text.catalogue import render, tr
from logs.reason import Reason
from profiles.schema import DistanceUsed, Profile

POLL_S = 0.05
READY_S = 60.0  # MediaPipe's first load on a slow disk
COLUMNS = ("ruler", "camera", "fps", "latency", "lost", "distance", "error", "other", "true", "false")


def compare_cameras(
    home: Home, sources: tuple[str, str], *, seconds: float, alone_s: float, ruler_m: float | None, patient: Profile
) -> Comparison:
    """Both cameras for so long, or until Ctrl-C; a number and Enter is the ruler's value in cm from then on.

    alone_s: the first one alone before that, so that the other's cost shows. Raises AppError, HardwareError.
    """
    config = load_config(home.config)
    cameras = [parse_camera(source, config.camera) for source in sources]
    refuse_same_device(cameras[0][0], cameras[1][0])
    setups = [_setup(home, config, camera, distance, patient) for camera, distance in cameras]
    comparison, lookers = Comparison(threshold_m=patient.press_threshold_m, ruler_m=ruler_m), list[Looker]()
    console = Console()
    try:
        lookers.append(Looker(setups[0], niceness=0))
        if alone_s:
            alone = Comparison(threshold_m=patient.press_threshold_m)
            _run(alone, lookers, alone_s, lambda: None)
            console.print(tr("compare.alone", camera=sources[0], fps=alone.total(0).fps))
        lookers.append(Looker(setups[1]))
        with Live(console=console, auto_refresh=False) as live:
            _run(comparison, lookers, seconds, lambda: live.update(comparison_table(comparison), refresh=True))
    finally:
        for looker in lookers:
            looker.close()
    return comparison


def _setup(home: Home, config: Config, camera: CameraConfig, used: DistanceUsed, patient: Profile) -> SessionSetup:
    """What a camera that looks needs to know; there is no session, and nobody uses its sockets."""
    return SessionSetup(
        session="compare",
        home=home.root,
        links=LinkDirectory(path=home.root, public=b"", secret=b""),
        config=msgspec.structs.replace(config, camera=camera),
        profile=msgspec.structs.replace(patient, distance_source=used),
        operator="",
    )


def _run(comparison: Comparison, lookers: list[Looker], seconds: float, shown: Callable[[], None]) -> None:
    """Take samples until the time is over that begins when every camera has given one."""
    begun_s, ready_s = 0.0, time.monotonic() + READY_S
    try:
        while not begun_s or time.monotonic() - begun_s < seconds:
            for which, looker in enumerate(lookers):
                for message in looker.receive():
                    if isinstance(message, CameraSample) and begun_s:
                        comparison.take(which, message)
                    elif isinstance(message, CameraSample):
                        comparison.newest[which] = message
                    elif isinstance(message, Reason):
                        comparison.faults[which] = message
            if not begun_s and all(comparison.newest[which] for which in range(len(lookers))):
                begun_s = time.monotonic()
            if not begun_s and time.monotonic() > ready_s:
                return
            comparison.ruler_m = _typed(comparison.ruler_m)
            shown()
            time.sleep(POLL_S)
    except KeyboardInterrupt:
        return


def _typed(ruler_m: float | None) -> float | None:
    """The value that was typed since, as metres; anything else leaves it."""
    if not sys.stdin.isatty() or not select.select([sys.stdin], [], [], 0)[0]:
        return ruler_m
    try:
        cm = float(sys.stdin.readline().replace(",", "."))
    except ValueError:
        return ruler_m
    return cm / 100 if 0 < cm <= 200 else None


def comparison_table(comparison: Comparison) -> Table:
    """Every row so far; below it what each camera measures now, or why it does not."""
    now = "   ".join(_now(comparison, which) for which in (0, 1))
    table = Table(title=tr("compare.title"), caption=now)
    for column in COLUMNS:
        table.add_column(tr(f"compare.column.{column}"), justify="left" if column == "camera" else "right")
    for tally in comparison.rows():
        table.add_row(
            _cm(tally.ruler_m),
            tally.camera,
            f"{tally.fps:.1f}",
            f"{tally.latency_ms:.0f}",
            f"{tally.lost_share:.0%}",
            _cm(tally.distance_m),
            "–" if tally.error is None else f"{tally.error:+.1%}",
            _cm(tally.from_other_m, "+.1f"),
            str(tally.presses[True]),
            str(tally.presses[False]),
        )
    return table


def _now(comparison: Comparison, which: int) -> str:
    sample, fault = comparison.newest[which], comparison.faults[which]
    if fault is not None:
        return render(fault)
    if sample is None:
        return tr("picture.waiting")
    word = tr("button.pressed" if sample.pressed else "button.released")
    return f"{sample.camera}: {_cm(sample.distance_m)} cm {word}"


def _cm(metres: float | None, style: str = ".1f") -> str:
    return "–" if metres is None else format(100 * metres, style)


def write_csv(comparison: Comparison, path: Path) -> None:
    """Every row. Raises AppError when it can't be written."""
    with writing(path):
        path.write_text(comparison.as_csv(), encoding="utf-8")


def write_plot(comparison: Comparison, path: Path) -> None:
    """Measured distance and frames per second over the ruler, a line a camera. Raises AppError."""
    rows = [one for one in comparison.rows() if one.distance_m is not None]
    with figure(path, 1, 2) as (_, panels):
        for camera in dict.fromkeys(one.camera for one in rows):
            own = [one for one in rows if one.camera == camera]
            true_cm = [100 * (one.ruler_m or one.distance_m or 0.0) for one in own]
            panels[0].plot(true_cm, [100 * (one.distance_m or 0.0) for one in own], "o-", label=camera)
            panels[1].plot(true_cm, [one.fps for one in own], "o-", label=camera)
        decorate(panels[0], "true_distance_cm", "measured_cm", "compared")
        decorate(panels[1], "true_distance_cm", "fps", "compared")
