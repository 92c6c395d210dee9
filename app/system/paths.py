"""Where everything is kept: one home, chosen by --home, RLEEX_HOME, or the platform's data directory."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import platformdirs


@dataclass(frozen=True, slots=True)
class Home:
    """The data directory and what lies in it."""

    root: Path

    @property
    def config(self) -> Path:
        """The configuration file."""
        return self.root / "config.toml"

    @property
    def cameras(self) -> Path:
        """Measured intrinsics, by camera."""
        return self.root / "cameras.toml"

    @property
    def profiles(self) -> Path:
        """Patient profiles, one TOML each."""
        return self.root / "profiles"

    @property
    def logs(self) -> Path:
        """Audit trails, one JSON Lines file a session, and the manifest that chains them."""
        return self.root / "logs"

    @property
    def models(self) -> Path:
        """The hand model."""
        return self.root / "models"

    @property
    def keys(self) -> Path:
        """Signing key, operators; 0700."""
        return self.root / "keys"

    @property
    def recordings(self) -> Path:
        """Recorded frames and bus logs, opt-in."""
        return self.root / "recordings"

    @property
    def lock(self) -> Path:
        """Held by the one console of this home."""
        return self.root / "console.lock"


def find_home(given: Path | None = None) -> Home:
    """The home: the one given, else RLEEX_HOME, else the platform's data directory. Makes nothing."""
    if given is not None:
        return Home(given.expanduser())
    if from_environment := os.environ.get("RLEEX_HOME"):
        return Home(Path(from_environment).expanduser())
    return Home(Path(platformdirs.user_data_dir("rleex")))
