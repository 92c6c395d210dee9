"""rleex evaluate response: Table 7, the closed loop."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import Console

    from app.evaluate.response import ResponseResult

cli = typer.Typer()


@cli.command()
def response(
    trials: Annotated[int, typer.Option(help="Trials a gesture.", min=1)] = 50,
    seeds: Annotated[str, typer.Option(help="Digital hands, comma-separated seeds.")] = "1,2,3",
    click: Annotated[float, typer.Option(help="Seconds to press and withdraw.", min=0.2, max=3.0)] = 0.3,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the result here as well.")] = None,
    home: Annotated[Path | None, typer.Option(help="Data directory.")] = None,
) -> None:
    """Table 7: success and response of the whole system, real processes, several hands."""
    import json

    from app.cli.progress import spinner, wide_console
    from app.demo.course import ALL_TWELVE
    from app.evaluate.response import evaluate_response
    from app.system.config import load_config
    from app.system.errors import AppError
    from app.system.hand_model import set_up_model
    from app.system.paths import find_home, hold_home

    console = wide_console()
    place = find_home(home)
    base = load_config(place.config)
    if not all(part.strip().isdigit() for part in seeds.split(",")):
        raise AppError(f"--seeds {seeds}: give whole numbers separated by commas, such as 1,2,3.")
    hands = [int(part) for part in seeds.split(",")]
    with hold_home(place), spinner(console, total=trials * len(ALL_TWELVE)) as watch:
        set_up_model(place, base)
        result = evaluate_response(place, base, trials=trials, seeds=hands, click_s=click, watch=watch)
    if json_file is not None:
        json_file.write_text(json.dumps(result.as_json(), indent=1) + "\n", encoding="utf-8")
    _show(console, result)
    if result.interrupted or result.gave_up:
        raise typer.Exit(130 if result.interrupted else 1)


def _show(console: Console, result: ResponseResult) -> None:
    from app.evaluate.response import PAPER_OVERALL, failure_table, response_table

    console.print(response_table(result))
    if result.failures():
        console.print(failure_table(result))
    figures = result.as_json()
    if result.interrupted:
        console.print("Interrupted: these are the trials made until then.")
    if result.gave_up:
        console.print(result.gave_up)
    if figures["success"] is None:
        return
    told = (
        f"success {100 * figures['success']:.2f} % of {figures['trials']}",
        f"mean response {figures['response_s']} s from recognition",
        f"visible {figures['visible_s']} s",
        f"release to command {figures['release_to_command_ms']} ms",
        f"unintended {figures['unintended']} (paper: {PAPER_OVERALL})",
    )
    console.print(", ".join(told))
