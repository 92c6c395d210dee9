"""rleex camera compare: two cameras before one hand, each in a process of its own, without a session."""

from __future__ import annotations

import select
import sys
import time
from collections.abc import Callable
from pathlib import Path

import msgspec
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.live import Live
from rich.table import Table

from app.evaluate.harness import decorate, figure, write_whole
from app.ipc.streams import LinkDirectory
from app.perception.camera_names import parse_camera, refuse_same_device
from app.perception.comparison import SHORTENED, SHOWN, Comparison
from app.perception.look import CameraSample, Looker, LookFault
from app.system.config import CameraConfig, Config, SessionSetup, load_config
from app.system.errors import AppError
from app.system.hand_model import set_up_model
from app.system.paths import Home
from app.text.catalogue import render, tr
from hal.errors import CameraFault, HardwareError
from logs.reason import Reason
from profiles.schema import DistanceUsed, Profile

POLL_S = 0.05
READY_S = 60.0  # MediaPipe's first load on a slow disk


def compare_cameras(
    home: Home,
    sources: tuple[str, str],
    *,
    seconds: float,
    alone_s: float,
    ruler_m: float | None,
    patient: Profile,
    csv: Path | None = None,
    plot: Path | None = None,
) -> Comparison:
    """Both cameras for so long, or until Ctrl-C; a number and Enter is the ruler's value in cm from then on.

    alone_s: the first one alone before that, so that the other's cost shows. csv, plot: files to write.
    Raises AppError, HardwareError.
    """
    config = load_config(home.config)
    cameras = [parse_camera(source, config.camera) for source in sources]
    refuse_same_device(cameras[0][0], cameras[1][0])
    set_up_model(home, config)
    setups = [_setup(home, config, camera, distance, patient) for camera, distance in cameras]
    comparison, lookers = Comparison(threshold_m=patient.press_threshold_m, ruler_m=ruler_m), list[Looker]()
    console = Console()
    try:
        lookers.append(Looker(setups[0], niceness=0))
        if alone_s:
            alone = Comparison(threshold_m=patient.press_threshold_m)
            _wait_for_frames(alone, lookers, sources)
            _run(alone, lookers, alone_s, lambda: None)
            console.print(tr("compare.alone", camera=sources[0], fps=alone.total(0).fps))
        lookers.append(Looker(setups[1]))
        _wait_for_frames(comparison, lookers, sources)
        try:
            with Live(console=console, auto_refresh=False) as live:
                _run(comparison, lookers, seconds, lambda: live.update(comparison_table(comparison), refresh=True))
                comparison.finish()
                live.update(comparison_table(comparison), refresh=True)
        finally:  # a stdout that is full or closed ends Live with an error, and costs no file
            if csv is not None:
                write_csv(comparison, csv)
            if plot is not None:
                write_plot(comparison, plot)
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


def _wait_for_frames(comparison: Comparison, lookers: list[Looker], sources: tuple[str, str]) -> None:
    """Until every camera has given a frame. Raises AppError, HardwareError for one that can't, or not in time."""
    ready_s = time.monotonic() + READY_S
    while True:
        _receive(comparison, lookers, counted=False)
        waiting = [which for which in range(len(lookers)) if comparison.newest[which] is None]
        for which in waiting:
            if (why := comparison.faults[which]) is not None:
                raise AppError(LookFault.NO_FRAME, camera=sources[which], why=why)
        if not waiting:
            return
        if time.monotonic() > ready_s:
            raise HardwareError(CameraFault.NO_FIRST_FRAME, camera=sources[waiting[0]], limit_s=READY_S)
        time.sleep(POLL_S)


def _run(comparison: Comparison, lookers: list[Looker], seconds: float, shown: Callable[[], None]) -> None:
    """Take samples for so long, or until a camera has ended."""
    until_s = time.monotonic() + seconds
    try:
        while time.monotonic() < until_s:
            _receive(comparison, lookers, counted=True)
            comparison.ruler_m = _typed(comparison.ruler_m)
            shown()
            if any(looker.ended for looker in lookers):
                return
            time.sleep(POLL_S)
    except KeyboardInterrupt:
        return


def _receive(comparison: Comparison, lookers: list[Looker], *, counted: bool) -> None:
    for which, looker in enumerate(lookers):
        for message in looker.receive():
            if isinstance(message, CameraSample) and counted:
                comparison.take(which, message)
            elif isinstance(message, CameraSample):
                comparison.newest[which] = message
            elif isinstance(message, Reason):
                comparison.faults[which] = message


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
    table = Table(title=tr("compare.title"), caption=now, caption_justify="left", box=SIMPLE_HEAD, padding=0)
    for column in SHOWN:
        heading = tr(f"compare.{'short' if column in SHORTENED else 'column'}.{column}")
        table.add_column(heading, justify="left" if column == "camera" else "right", no_wrap=column != "camera")
    table.add_column(tr("compare.column.unknown"), justify="right")
    for tally in comparison.rows():
        table.add_row(*tally.shown(), str(tally.presses[None]))
    return table


def _now(comparison: Comparison, which: int) -> str:
    sample, fault = comparison.newest[which], comparison.faults[which]
    if fault is not None:
        return render(fault)
    if sample is None:
        return tr("picture.waiting")
    if sample.distance_m is None:
        return f"{sample.camera}: {render(sample.why) if sample.why else tr('compare.no_measurement')}"
    word = tr("button.pressed" if sample.pressed else "button.released")
    return f"{sample.camera}: {100 * sample.distance_m:.1f} cm {word}"


def write_csv(comparison: Comparison, path: Path) -> None:
    """Every row; on the terminal where it can't be written, which raises AppError."""
    table = comparison.as_csv()
    try:
        write_whole(path, table.encode())
    except AppError:
        sys.stdout.write(table)
        raise


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
