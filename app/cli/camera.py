"""rleex camera: list, show and calibrate cameras."""

from __future__ import annotations

import time
from contextlib import closing, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from rich.text import Text

from app.cli.common import HomeOption, check_figure, check_finite, check_output
from app.cli.compare_cameras import compare_cameras
from app.cli.permission import sign_in
from app.perception.camera_names import kind_of
from app.system.authority import Subject
from app.system.config import CameraConfig, load_config, with_camera
from app.system.operators import Permission
from app.system.paths import Home, find_home
from app.text.catalogue import render, tr
from hal.cameras.camera import FIRST_FRAME_S, Camera, EndOfRecording, Frame, ImageArray
from hal.cameras.factory import open_camera
from hal.cameras.intrinsics import Board, Corners, find_corners, save
from hal.cameras.intrinsics import calibrate as solve
from hal.cameras.playback import image_files, read_image
from hal.errors import CameraFault, HardwareError, RecordingFault
from logs.reading.regular import path_named
from logs.reason import key_of, sanitize_terminal
from profiles.store import ProfileStore

if TYPE_CHECKING:
    from collections.abc import Generator


cli = typer.Typer()

KEPT_IMAGES = 20
BETWEEN_IMAGES_S = 1.0  # time to move the board


@cli.command("list")
def list_cameras(home: HomeOption = None) -> None:
    """List the cameras of this machine, and how to name them in the configuration."""
    from hal.cameras.webcam_list import list_webcams

    table = Table(*(tr(f"camera.{column}") for column in ("kind", "device", "name")), box=None)
    table.add_row("digital-hand", "", tr("camera.digital_hand"))
    for entry in list_webcams():
        table.add_row("webcam", str(entry.index), Text(sanitize_terminal(entry.name)))
    for kind, device, name in _realsense_rows():
        table.add_row(kind, device, Text(sanitize_terminal(name)))
    console = Console(soft_wrap=True)
    console.print(table)
    console.print(tr("camera.choose", path=find_home(home).config), markup=False)


@cli.command()
def show(
    source: Annotated[str, typer.Argument(help="digital-hand, a webcam's name or number, realsense, or a path.")],
    home: HomeOption = None,
) -> None:
    """Open a camera or recording, and show its resolution, rate, intrinsics and faults of its image."""
    from hal.cameras.exposure import image_fault

    camera = _open(source, find_home(home))
    try:
        camera.open()
        frame, rate_hz = _first_and_rate(camera)
        lens, fault = frame.intrinsics, image_fault(frame.image_bgr)
        rows = {
            "name": camera.name,
            "resolution": f"{lens.width_px}x{lens.height_px}",
            "rate": tr("camera.frames_per_second", rate_hz=rate_hz) if rate_hz else tr("camera.rate_unknown"),
            "focal": f"{lens.fx_px:.1f} x {lens.fy_px:.1f} px ({tr(lens.source)})",
            "centre": f"{lens.cx_px:.1f}, {lens.cy_px:.1f} px",
            "depth": tr("camera.no" if frame.depth_m is None else "camera.yes"),
            "image": tr("camera.good" if fault is None else fault),
        }
        table = Table.grid(padding=(0, 2))
        for key, value in rows.items():
            table.add_row(tr(f"camera.{key}"), Text(sanitize_terminal(value)))
        Console(soft_wrap=True, highlight=False).print(table)
    finally:
        camera.close()


@cli.command()
def compare(
    first: Annotated[str, typer.Argument(help="As for show; digital-d435i gives depth; :SEED, @RATE behind a name.")],
    second: Annotated[str, typer.Argument(help="The other camera, before the same hand.")],
    seconds: Annotated[float, typer.Option(callback=check_finite, min=1, max=86_400, help="How long.")] = 60.0,
    alone: Annotated[
        float, typer.Option(callback=check_finite, min=0, max=3600, help="Seconds of the first camera alone before.")
    ] = 0.0,
    ruler: Annotated[
        float | None, typer.Option(callback=check_finite, min=5, max=200, help="The true distance, cm.")
    ] = None,
    patient: Annotated[str, typer.Option(help="Whose palm and press threshold.")] = "demo",
    csv: Annotated[Path | None, typer.Option(callback=check_output, help="Write the table here.")] = None,
    plot: Annotated[Path | None, typer.Option(callback=check_figure, help="Write a plot of it (PNG) here.")] = None,
    home: HomeOption = None,
) -> None:
    """Compare two cameras before one hand; a number and Enter is the ruler's cm from then on, Ctrl-C ends."""
    place = find_home(home)
    result = compare_cameras(
        place,
        (first, second),
        seconds=seconds,
        alone_s=alone,
        ruler_m=None if ruler is None else ruler / 100,
        patient=ProfileStore(place.profiles).load(patient),
        csv=csv,
        plot=plot,
    )
    ended = (None, key_of(RecordingFault.ENDED))  # a recording ends as it should
    failed = any(one is not None and one.code not in ended for one in result.faults)
    if failed or not all(result.total(which).frames for which in (0, 1)):
        raise typer.Exit(1)


@cli.command()
def calibrate(
    source: Annotated[str, typer.Argument(help="A webcam's name or number, or a folder of images.")],
    camera: Annotated[str, typer.Option(help="The camera's name, when a folder is given.")] = "",
    columns: Annotated[int, typer.Option(min=3, max=40, help="Inner corners across.")] = 9,
    rows: Annotated[int, typer.Option(min=3, max=40, help="Inner corners down.")] = 6,
    square_mm: Annotated[float, typer.Option(callback=check_finite, min=1, max=500, help="Side of a square.")] = 25.0,
    home: HomeOption = None,
) -> None:
    """Measure a camera's intrinsics on a chessboard, and keep them for this camera.

    A therapist or engineer signs in first.
    """
    by = sign_in(home, Permission.CALIBRATE)
    place = find_home(home)
    board = Board(columns=columns, rows=rows, square_m=square_mm / 1000)
    name, images = _images(source, camera, place)
    corners, size = _find_boards(board, images)
    result = solve(corners, board, *size)
    permit = partial(by.change, Permission.CALIBRATE, Subject.CALIBRATION, name)
    save(place.cameras, name, result.intrinsics, result.residual_px, permit)
    measured = result.intrinsics
    text = tr(
        "camera.calibrated",
        camera=name,
        fx_px=measured.fx_px,
        fy_px=measured.fy_px,
        cx_px=measured.cx_px,
        cy_px=measured.cy_px,
        width_px=size[0],
        height_px=size[1],
        residual_px=result.residual_px,
        images=result.used,
        path=place.cameras,
    )
    Console(soft_wrap=True, highlight=False).print(text, markup=False)


def _find_boards(board: Board, images: Generator[ImageArray, None, None]) -> tuple[list[Corners], tuple[int, int]]:
    """The board's corners wherever it is visible whole, and the images' size; Ctrl-C ends the search early."""
    found: list[Corners] = []
    size = (0, 0)
    with Progress(transient=True) as progress, suppress(KeyboardInterrupt), closing(images):
        task = progress.add_task(tr("camera.boards", boards=0), total=None)
        for image in images:
            this = (image.shape[1], image.shape[0])
            if size not in ((0, 0), this):
                first, other = (f"{width}x{height}" for width, height in (size, this))
                raise HardwareError(CameraFault.IMAGE_SIZES_DIFFER, first=first, other=other)
            size = this
            corners = find_corners(image, board)
            if corners is not None:
                found.append(corners)
            progress.update(task, advance=1, description=tr("camera.boards", boards=len(found)))
            if len(found) >= KEPT_IMAGES:
                break
    return found, size


def _images(source: str, camera: str, home: Home) -> tuple[str, Generator[ImageArray, None, None]]:
    """The camera's name, and images of the board: of a folder, or one a second of a live camera."""
    folder = path_named(source)
    if folder.is_dir():
        if not camera:
            raise HardwareError(CameraFault.CAMERA_NAME_MISSING)
        return camera, (read_image(path) for path in image_files(folder))
    kind, device = kind_of(source)
    if kind == "realsense":
        raise HardwareError(CameraFault.FACTORY_CALIBRATED)
    live = open_as(load_config(home.config).camera, kind, device)  # an earlier calibration may not suit it
    live.open()
    return live.name, _live_images(live)


def _live_images(camera: Camera) -> Generator[ImageArray, None, None]:
    last_s = 0.0
    with closing(camera), suppress(EndOfRecording):
        while True:
            frame = camera.read(0.5)
            if frame is not None and time.monotonic() - last_s >= BETWEEN_IMAGES_S:
                last_s = time.monotonic()
                yield frame.image_bgr


def _open(source: str, home: Home) -> Camera:
    """A source as people name it, with the configuration's settings."""
    return open_as(load_config(home.config).camera, *kind_of(source), home.cameras)


def open_as(settings: CameraConfig, kind: str, device: str, store: Path | None = None) -> Camera:
    """A camera with these settings."""
    settings = with_camera(settings, kind, device)
    return open_camera(
        kind,
        device=device,
        width_px=settings.width_px,
        height_px=settings.height_px,
        rate_hz=settings.rate_hz,
        focal_px=settings.focal_px,
        mirrored=settings.mirrored,
        seed=settings.seed,
        store=store,
    )


def _first_and_rate(camera: Camera) -> tuple[Frame, float]:
    """The first frame, and the rate over the next ones as far as there are any."""
    first: Frame | None = None
    times: list[int] = []
    give_up = time.monotonic() + FIRST_FRAME_S
    try:
        while len(times) < 30 and time.monotonic() < give_up:
            frame = camera.read(0.5)
            if frame is not None:
                first = first or frame
                times.append(frame.captured_ns)
    except EndOfRecording:
        pass  # a short recording: what came is enough
    if first is None:
        raise HardwareError(CameraFault.NO_FIRST_FRAME, camera=camera.name, limit_s=FIRST_FRAME_S)
    spans_ns = times[-1] - times[0]
    return first, (len(times) - 1) * 1e9 / spans_ns if spans_ns else 0.0


def _realsense_rows() -> list[tuple[str, str, str]]:
    from hal.cameras.realsense_devices import list_realsense

    try:
        return [("realsense", serial, name) for serial, name in list_realsense()]
    except HardwareError as error:
        return [("realsense", "", render(error))]
