"""rleex run."""

from __future__ import annotations

import typer

cli = typer.Typer()
