"""What every test shares."""

from __future__ import annotations

from hypothesis import HealthCheck, settings

# A busy machine is slow, not wrong: time limits belong to `make bench`.
settings.register_profile("rleex", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("rleex")
