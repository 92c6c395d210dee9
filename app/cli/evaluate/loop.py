"""rleex evaluate: speed of the pipeline, response of the whole system, all of the paper's tables, outcome measures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer

from app.cli.common import (
    HomeOption,
    Json,
    check_appended,
    check_input_folder,
    check_output_folder,
    show,
    shown_after,
    spinner,
    wide_console,
)
from app.cli.evaluate.common import Click, Seeds, hand_model, progress, status_line
from app.demo.scenario import ALL_TWELVE
from app.evaluate.harness import click_range, require_extra, seed_numbers, write_json, writing
from app.system.config import load_config, load_device
from app.system.hand_model import set_up_model
from app.system.paths import find_home, hold_home
from app.text.catalogue import tr

if TYPE_CHECKING:
    from rich.table import Table

cli = typer.Typer()
Onnx = Annotated[
    list[Path] | None,
    typer.Option(help="Another hand detector, exported to ONNX: YOLOv5, YOLOv8 or SSD. May be given again."),
]


@cli.command()
def speed(
    directory: Annotated[
        Path | None, typer.Argument(help="Folder with frames.csv; without it, the digital hand.")
    ] = None,
    frames: Annotated[int, typer.Option(help="How many frames at most.", min=30)] = 300,
    workers: Annotated[
        int | None,
        typer.Option(
            help="Time also 1 and N processes at once, each with a recording of its own; default: one a core; 0: none.",
            min=0,
            max=64,
        ),
    ] = None,
    onnx: Onnx = None,
    json_file: Json = None,
    home: HomeOption = None,
) -> None:
    """Table 4: the whole pipeline's speed beside bare MediaPipe's and other detectors' on the same frames."""
    from app.evaluate.loop import speed as timing
    from app.evaluate.loop.frames import frames_for_speed

    if onnx:
        require_extra("evaluate", "onnx", "onnxruntime")

    model = hand_model(home)
    with frames_for_speed(directory, frames) as recorded:
        images = recorded.images()
        with progress("timing", len(images) + min(timing.WARM_UP, len(images))) as step:
            figures = timing.measure_speed(images, model, focal_px=recorded.focal_px, onnx=onnx or [], step=step)
        height, width = images[0].shape[:2]
        parts: list[Table | str] = [
            timing.speed_table(figures, width, height),
            tr("evaluate.speed.summary", **msgspec.to_builtins(figures)),
            timing.detectors_table(figures),
            *(tr("evaluate.speed.unreadable", file=path) for path in recorded.unreadable),
        ]
        offline = []
        with shown_after(parts):
            for count in timing.worker_counts(workers):
                with status_line() as status:
                    status(tr("evaluate.progress.processes", count=count))
                    offline.append(timing.measure_throughput(recorded, model, count))
                parts.append(tr("evaluate.speed.offline", workers=count, fps=offline[-1].fps))
            made = {"unreadable": [*map(str, recorded.unreadable)], "offline": msgspec.to_builtins(offline)}
            write_json(msgspec.to_builtins(figures) | made, json_file)


@cli.command()
def response(
    attempts: Annotated[int, typer.Option("--trials", help="Attempts a gesture.", min=1)] = 50,
    seeds: Seeds = "1-3",
    click: Click = "0.3",
    keep: Annotated[
        Path | None,
        typer.Option(callback=check_appended, help="Keep each session's figures in this file; go on where it ends."),
    ] = None,
    json_file: Json = None,
    home: HomeOption = None,
) -> None:
    """Table 7: success and response of the whole system, real processes, several hands."""
    from app.evaluate.loop.response import evaluate_response
    from app.evaluate.loop.table7 import shown

    place = find_home(home)
    base = load_config(place.config)
    numbers, click_s = seed_numbers(seeds), click_range(click)
    with hold_home(place), spinner(wide_console(), total=attempts * len(ALL_TWELVE)) as watch:
        set_up_model(place, base)
        result = evaluate_response(
            place, base, attempts=attempts, seeds=numbers, click_s=click_s, watch=watch, keep=keep
        )
    with shown_after(shown(result)):
        write_json(result.as_json(), json_file)
    if result.interrupted or result.gave_up:
        raise typer.Exit(130 if result.interrupted else 1)


@cli.command()
def paper(
    out: Annotated[
        Path, typer.Option("--out", callback=check_output_folder, help="Folder for the page and its figures.")
    ],
    data: Annotated[
        Path | None,
        typer.Option(
            callback=check_input_folder, help="Folder with gestures/ and distance/; without it, digital hands."
        ),
    ] = None,
    attempts: Annotated[int, typer.Option("--trials", help="Table 7: attempts a gesture.", min=1)] = 150,
    seeds: Seeds = "1-3",
    changes: Annotated[int, typer.Option(help="Table 6: posture changes at each distance.", min=4)] = 20,
    onnx: Onnx = None,
    home: HomeOption = None,
) -> None:
    """Tables 3 to 7 beside the paper's figures on one HTML page; an interrupted run goes on where it ended."""
    from app.evaluate.loop.speed import open_detectors
    from app.evaluate.paper.make import jobs, made_before, make, run_file
    from app.evaluate.paper.page import write_page

    require_extra("evaluate", "matplotlib", "jinja2", "onnx", "onnxruntime", "tflite")
    seed_numbers(seeds)
    open_detectors(onnx or [])  # what would end table 4 must not cost table 3's time before
    options = () if home is None else ("--home", str(home))
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
    try:
        for job in jobs(data, attempts=attempts, hands=seeds, changes=changes, onnx=onnx or []):
            if (run := made_before(job, out)) is None:
                show(tr("evaluate.paper.making", table=job.table, command=job.command))
                make(job, out, options)
            else:
                show(tr("evaluate.paper.kept", table=job.table, date=run.date, file=run_file(out, job.table)))
    except KeyboardInterrupt:
        show(tr("evaluate.paper.interrupted", page=write_page(out)))
        raise typer.Exit(130) from None
    show(tr("evaluate.paper.written", page=write_page(out)))


@cli.command()
def outcomes(json_file: Json = None, home: HomeOption = None) -> None:
    """Outcome measures of simulated patients beside MuJoCo's feet and clock; exit status 1 beyond 1 %."""
    from app.evaluate.outcomes.compare import CASES, LIMIT, compare, errors_table

    device = load_device(load_config(find_home(home).config).joints)
    with progress("walks", len(CASES)) as step:
        found = compare(CASES, device, step)
    worst = max(abs(error) for one in found for error in one.errors.values())
    with shown_after([errors_table(found), tr("evaluate.outcomes.worst", worst=worst, limit=LIMIT)]):
        write_json([one.as_json() for one in found], json_file)
    if not all(one.passed for one in found):
        raise typer.Exit(1)
