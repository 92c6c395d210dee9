"""Options that the evaluate commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Json = Annotated[Path | None, typer.Option("--json", help="Write the figures here as well.")]
Home = Annotated[Path | None, typer.Option("--home", help="Data directory.")]
