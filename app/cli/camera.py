"""rleex camera: list, show and calibrate cameras."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Generator

    from app.system.config import CameraConfig
    from app.system.paths import Home
    from hal.cameras.camera import Camera, Frame, ImageArray
    from hal.cameras.intrinsics import Board, Corners

cli = typer.Typer()

FIRST_FRAME_S = 10.0
KEPT_PICTURES = 20
BETWEEN_PICTURES_S = 1.0  # time to move the board
HomeOption = Annotated[Path | None, typer.Option(help="Data directory.")]


@cli.command("list")
def list_cameras(home: HomeOption = None) -> None:
    """List the cameras of this machine, and how to name them in the configuration."""
    from rich.console import Console
    from rich.table import Table

    from app.system.paths import find_home
    from hal.cameras.webcam import list_webcams

    table = Table(box=None)
    for title in ("kind", "device", "name"):
        table.add_column(title)
    table.add_row("digital-hand", "", "a simulated hand, always there")
    for entry in list_webcams():
        table.add_row("webcam", str(entry.index), entry.name)
    for kind, device, name in _realsense_rows():
        table.add_row(kind, device, name)
    console = Console(soft_wrap=True)
    console.print(table)
    console.print(f"Choose one with kind and device under [camera] in {find_home(home).config}.", markup=False)


@cli.command()
def show(
    source: Annotated[str, typer.Argument(help="digital-hand, a webcam's name or number, realsense, or a path.")],
    home: HomeOption = None,
) -> None:
    """Open a camera or recording, and tell its resolution, rate, intrinsics and what is wrong with its picture."""
    from rich.console import Console

    from app.system.paths import find_home
    from hal.cameras.exposure import hint

    camera = _open(source, find_home(home))
    try:
        camera.open()
        frame, rate_hz = _first_and_rate(camera)
        seen = frame.intrinsics
        depth = "yes" if frame.depth_m is not None else "no"
        console = Console(soft_wrap=True, highlight=False)
        console.print(f"name        {camera.name}", markup=False)
        console.print(f"resolution  {seen.width_px}x{seen.height_px}")
        console.print(f"rate        {rate_hz:.1f}/s" if rate_hz else "rate        too few pictures to tell")
        console.print(f"focal       {seen.fx_px:.1f} x {seen.fy_px:.1f} px ({seen.source.value})")
        console.print(f"centre      {seen.cx_px:.1f}, {seen.cy_px:.1f} px")
        console.print(f"depth       {depth}")
        console.print(f"picture     {hint(frame.image_bgr) or 'good'}")
    finally:
        camera.close()


@cli.command()
def calibrate(
    source: Annotated[str, typer.Argument(help="A webcam's name or number, or a folder of pictures.")],
    camera: Annotated[str, typer.Option(help="The camera's name, when a folder is given.")] = "",
    columns: Annotated[int, typer.Option(min=3, max=40, help="Inner corners across.")] = 9,
    rows: Annotated[int, typer.Option(min=3, max=40, help="Inner corners down.")] = 6,
    square_mm: Annotated[float, typer.Option(min=1, max=500, help="Side of a square.")] = 25.0,
    home: HomeOption = None,
) -> None:
    """Measure a camera's intrinsics on a chessboard, and keep them for this camera."""
    from rich.console import Console

    from app.system.paths import find_home
    from hal.cameras.intrinsics import Board, save
    from hal.cameras.intrinsics import calibrate as solve

    place = find_home(home)
    board = Board(columns=columns, rows=rows, square_m=square_mm / 1000)
    name, pictures = _pictures(source, camera, place)
    corners, size = _look_for(board, pictures)
    result = solve(corners, board, *size)
    save(place.cameras, name, result.intrinsics, result.residual_px)
    Console(soft_wrap=True, highlight=False).print(
        f"{name}: focal length {result.intrinsics.fx_px:.1f} x {result.intrinsics.fy_px:.1f} px, centre "
        f"{result.intrinsics.cx_px:.1f}, {result.intrinsics.cy_px:.1f} px at {size[0]}x{size[1]}; residual "
        f"{result.residual_px:.3f} px over {result.used} pictures; kept in {place.cameras}.",
        markup=False,
    )


def _look_for(board: Board, pictures: Generator[ImageArray, None, None]) -> tuple[list[Corners], tuple[int, int]]:
    """The board's corners wherever it was seen whole, and the pictures' size; Ctrl-C ends the looking early."""
    from contextlib import closing, suppress

    from rich.progress import Progress

    from hal.cameras.intrinsics import find_corners
    from hal.errors import HardwareError

    found: list[Corners] = []
    size = (0, 0)
    with Progress(transient=True) as progress, suppress(KeyboardInterrupt), closing(pictures):
        task = progress.add_task("pictures with the whole board: 0", total=None)
        for image in pictures:
            this = (image.shape[1], image.shape[0])
            if size not in ((0, 0), this):
                raise HardwareError(
                    f"The pictures differ in size ({size[0]}x{size[1]} and {this[0]}x{this[1]}): use one resolution."
                )
            size = this
            corners = find_corners(image, board)
            if corners is not None:
                found.append(corners)
            progress.update(task, advance=1, description=f"pictures with the whole board: {len(found)}")
            if len(found) >= KEPT_PICTURES:
                break
    return found, size


def _pictures(source: str, camera: str, home: Home) -> tuple[str, Generator[ImageArray, None, None]]:
    """The camera's name, and pictures of the board: of a folder, or one a second of a live camera."""
    from hal.cameras.playback import picture_files, read_picture
    from hal.errors import HardwareError

    folder = Path(source).expanduser()
    if folder.is_dir():
        if not camera:
            raise HardwareError("A folder tells no camera: give the name that `rleex camera list` shows with --camera.")
        return camera, (read_picture(path) for path in picture_files(folder))
    live = _open(source, home)
    live.open()
    return live.name, _live_pictures(live)


def _live_pictures(camera: Camera) -> Generator[ImageArray, None, None]:
    import time

    last_s = 0.0
    try:
        while True:
            frame = camera.read(0.5)
            if frame is not None and time.monotonic() - last_s >= BETWEEN_PICTURES_S:
                last_s = time.monotonic()
                yield frame.image_bgr
    finally:
        camera.close()


def _open(source: str, home: Home) -> Camera:
    """A source as people name it, with the configuration's settings."""
    from app.system.config import load_config
    from hal.cameras.factory import open_camera

    settings: CameraConfig = load_config(home.config).camera
    kind, device = _kind_of(source)
    return open_camera(
        kind,
        device=device,
        width_px=settings.width_px,
        height_px=settings.height_px,
        rate_hz=settings.rate_hz,
        focal_px=settings.focal_px if settings.kind == kind else None,
        mirrored=settings.mirrored and settings.kind == kind,
        seed=settings.seed,
        store=home.cameras,
    )


def _kind_of(source: str) -> tuple[str, str]:
    if source == "digital-hand":
        return source, ""
    if source == "realsense" or source.lower().endswith((".bag", ".db3")):
        return "realsense", "" if source == "realsense" else source
    looks_like_path = "/" in source and not source.startswith("/dev/video")
    if looks_like_path or Path(source).expanduser().exists():
        return "recording", source
    return "webcam", source


def _first_and_rate(camera: Camera) -> tuple[Frame, float]:
    """The first frame, and the rate over the next ones as far as there are any."""
    import time

    from hal.cameras.camera import EndOfRecording
    from hal.errors import HardwareError

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
        raise HardwareError(f"{camera.name} gave no picture within {FIRST_FRAME_S:g} s: check it with another program.")
    spans_ns = times[-1] - times[0]
    return first, (len(times) - 1) * 1e9 / spans_ns if spans_ns else 0.0


def _realsense_rows() -> list[tuple[str, str, str]]:
    from hal.cameras.realsense import list_realsense
    from hal.errors import HardwareError

    try:
        return [("realsense", serial, name) for serial, name in list_realsense()]
    except HardwareError as error:
        return [("realsense", "", str(error))]
