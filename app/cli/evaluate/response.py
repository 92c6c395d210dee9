"""rleex evaluate response: Table 7, the closed loop."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

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

    from rich.console import Console

    from app.cli.progress import spinner
    from app.config import load_config
    from app.demo.course import ALL_TWELVE
    from app.errors import AppError
    from app.evaluate.response import PAPER_OVERALL, evaluate_response, response_table
    from app.lock import hold_home
    from app.model import set_up_model
    from app.paths import find_home

    console = Console()
    place = find_home(home)
    base = load_config(place.config)
    if not all(part.strip().isdigit() for part in seeds.split(",")):
        raise AppError(f"--seeds {seeds}: give whole numbers separated by commas, such as 1,2,3.")
    hands = [int(part) for part in seeds.split(",")]
    with hold_home(place), spinner(console, total=trials * (len(ALL_TWELVE) + 1)) as watch:
        set_up_model(place, base)
        result = evaluate_response(place, base, trials=trials, seeds=hands, click_s=click, watch=watch)
    console.print(response_table(result))
    figures = result.as_json()
    console.print(
        f"success {100 * figures['success']:.2f} %, mean response {figures['response_s']} s from recognition, "
        f"visible {figures['visible_s']} s, unintended {figures['unintended']} (paper: {PAPER_OVERALL})"
    )
    if json_file is not None:
        json_file.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
