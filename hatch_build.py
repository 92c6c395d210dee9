"""Build hook: a wheel carries the catalogues as gettext reads them (.mo), compiled from the .po in the tree."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CatalogueHook(BuildHookInterface):
    """Compiles before the files are gathered, for wheels and editable installs alike."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:  # noqa: ARG002 - the interface
        """Write each .mo that is missing or out of date and add it to the wheel."""
        root = Path(self.root)
        sys.path.insert(0, str(root))
        from app.text.compile import compile_catalogues

        compile_catalogues()
        build_data["artifacts"].append("app/text/locales/**/*.mo")
