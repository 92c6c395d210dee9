"""rleex evaluate video."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.cli.evaluate.looking import hand_model
from app.cli.evaluate.options import Home, Json

cli = typer.Typer()


@cli.command()
def video(
    where: Annotated[Path, typer.Argument(help="Folder with frames.csv, or a video file.")],
    labels: Annotated[
        Path | None, typer.Option(help="A video's labels, as lines of frame,label; else the .csv beside it.")
    ] = None,
    json_file: Json = None,
    home: Home = None,
) -> None:
    """How steadily both rule sets tell gestures in labelled footage."""
    import msgspec
    from rich.console import Console
    from rich.table import Table

    from app.cli.progress import bar
    from app.evaluate.footage import read_footage
    from app.evaluate.gesture_report import write_json
    from app.evaluate.video import measure_sequence, run_sequence, said
    from kgdfa.gesture import RuleSet
    from kgdfa.published import PublishedRules
    from kgdfa.robust import RobustRules

    console, footage = Console(), read_footage(where, labels)
    figures = {}
    rule_sets: tuple[RuleSet, ...] = (PublishedRules(), RobustRules())
    for rules in rule_sets:
        with bar(console, f"{rules.name} rules", len(footage.labels)) as tell:
            spoken = [said(report) for report in run_sequence(footage, hand_model(home), rules, tell)]
        figures[rules.name] = measure_sequence(
            footage.labels, [raw for raw, _ in spoken], [voted for _, voted in spoken]
        )
    table = Table(title=f"{where}: {len(footage.labels)} frames")
    table.add_column("")
    for name in figures:
        table.add_column(name, justify="right")
    plain: dict[str, dict[str, float]] = {name: msgspec.to_builtins(one) for name, one in figures.items()}
    for field in next(iter(plain.values())):
        table.add_row(field.replace("_", " "), *(f"{one[field]:.3g}" for one in plain.values()))
    console.print(table)
    if json_file is not None:
        write_json({"frames": len(footage.labels), "rules": plain}, json_file)
