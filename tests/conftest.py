"""What every test shares."""

from __future__ import annotations

from hypothesis import settings

# A busy machine is slow, not wrong: time limits belong to `make bench`.
settings.register_profile("rleex", deadline=None)
settings.load_profile("rleex")
