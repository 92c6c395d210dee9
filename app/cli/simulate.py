"""rleex simulate."""

from __future__ import annotations

import typer

cli = typer.Typer()
