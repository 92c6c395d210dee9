"""rleex evaluate: measures what the documents claim. The evaluations are in `app/evaluate`, loaded when they run."""

from __future__ import annotations

import typer

from app.cli.evaluate import gestures, loop, trigger, voice

cli = typer.Typer(no_args_is_help=True)
for subject in (gestures, loop, trigger, voice):
    cli.add_typer(subject.cli)
