"""How often the word stops, and how often something else does."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from msgspec import Struct, structs
from rich.table import Table

from app.evaluate.harness import Step, percent, table
from app.evaluate.voice.recordings import Recording
from app.voice.listener import Spotter
from app.voice.spotter import KeywordSpotter
from hal.microphone import BLOCK_SAMPLES, RATE_HZ, SAMPLE_BYTES

SILENCE = bytes(RATE_HZ // 2 * SAMPLE_BYTES)  # after each recording, so that its last word ends


class GroupResult(Struct, kw_only=True):
    """Recordings of one group."""

    group: str
    stop: bool
    recordings: int = 0
    stopped: int = 0  # recordings with at least one stop
    stops: int = 0
    seconds: float = 0.0

    @property
    def share(self) -> float:
        """Of recordings that stopped: the recall where the word is in them."""
        return self.stopped / max(self.recordings, 1)

    @property
    def per_hour(self) -> float:
        """Stops an hour of sound."""
        return self.stops * 3600 / max(self.seconds, 1e-9)


def measure(recordings: Iterable[Recording], spotter: KeywordSpotter, step: Step = lambda: None) -> list[GroupResult]:
    """Groups in the order of their first recording."""
    found: dict[tuple[str, bool], GroupResult] = {}
    for one in recordings:
        result = found.setdefault((one.group, one.stop), GroupResult(group=one.group, stop=one.stop))
        spotter.begin()
        stops = count_stops(one.samples + SILENCE, spotter)
        result.recordings += 1
        result.stopped += stops > 0
        result.stops += stops
        result.seconds += len(one.samples) / SAMPLE_BYTES / RATE_HZ
        step()
    return list(found.values())


def count_stops(samples: bytes, spotter: Spotter) -> int:
    """In blocks, as from the microphone."""
    block = BLOCK_SAMPLES * SAMPLE_BYTES
    return sum(spotter.detect(samples[at : at + block]) for at in range(0, len(samples), block))


def tables(results: list[GroupResult]) -> tuple[Table, Table]:
    """With the word, and without it."""
    spoken = [(one.group, one.recordings, percent(one.share)) for one in results if one.stop]
    others = [
        (one.group, one.recordings, f"{one.seconds / 3600:.2f}", one.stopped, one.stops, f"{one.per_hour:.1f}")
        for one in results
        if not one.stop
    ]
    return (
        table("voice.word", "group recordings recall", spoken),
        table("voice.other", "group recordings hours stopped stops per_hour", others),
    )


def as_json(results: list[GroupResult]) -> list[dict[str, Any]]:
    """The figures."""
    return [structs.asdict(one) | {"share": one.share, "per_hour": one.per_hour} for one in results]
