"""rleex evaluate: one file a subject."""

from __future__ import annotations

import typer

from app.cli.evaluate import distance, gestures, response

cli = typer.Typer(no_args_is_help=True)
for part in (gestures, distance, response):
    cli.add_typer(part.cli)
