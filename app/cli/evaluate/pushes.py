"""rleex evaluate pushes."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from app.cli.evaluate.looking import hand_model
from app.cli.evaluate.options import Home, Json

cli = typer.Typer()


@cli.command()
def pushes(
    hands: Annotated[int, typer.Option(help="Digital hands.", min=1)] = 6,
    first_seed: Annotated[int, typer.Option(help="Number of the first digital person.", min=0)] = 1,
    each: Annotated[int, typer.Option(help="Pushes of a hand with each gesture.", min=1)] = 2,
    click: Annotated[float, typer.Option(help="Seconds to press and withdraw.", min=0.2, max=3.0)] = 0.3,
    workers: Annotated[int, typer.Option(help="Processes that look at hands at the same time.", min=1, max=64)] = 2,
    json_file: Json = None,
    home: Home = None,
) -> None:
    """Quick pushes of many hands with all twelve gestures, frame by frame: which command, and why others do not."""
    from app.cli.progress import bar, wide_console
    from app.evaluate.pushes import bouts, evaluate_pushes
    from app.evaluate.pushes_tables import failed_pushes, pushes_by_gesture, told
    from app.evaluate.watcher import processes

    console = wide_console()
    wanted = bouts(range(first_seed, first_seed + hands), pushes=each, click_s=click)
    with processes(hand_model(home), workers) as pool, bar(console, "pushing", len(wanted)) as tell:
        made = evaluate_pushes(pool, wanted, tell)
    if json_file is not None:
        result = {"click_s": click, "pushes": [push.as_json() for push in made]}
        json_file.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    console.print(pushes_by_gesture(made))
    console.print(failed_pushes(made))
    console.print(told(made))
    if any(push.unasked for push in made):
        raise typer.Exit(1)
