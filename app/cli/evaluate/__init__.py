"""rleex evaluate: one file a subject."""

from __future__ import annotations

import typer

from app.cli.evaluate import distance, finding, gestures, preprocessing, pushes, response, speed, video

cli = typer.Typer(no_args_is_help=True)
for part in (gestures, finding, video, preprocessing, speed, distance, pushes, response):
    cli.add_typer(part.cli)
