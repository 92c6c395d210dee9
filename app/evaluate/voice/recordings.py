"""Recordings with and without the word: read from a folder or synthetic; how often it stops, and what else does."""

from __future__ import annotations

import csv
import io
import wave
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct, structs
from rich.table import Table

from app.evaluate.harness import EvaluateFault, Step, percent, table, write_whole
from app.evaluate.readings import Row, read_table
from app.evaluate.voice.speech import PHRASES, Generator, Phrase, Voices, levelled, mixed, noises, speak, voices
from app.system.errors import AppError
from app.voice.listener import Spotter
from app.voice.spotter import KeywordSpotter
from hal.errors import HardwareError
from hal.microphone import BLOCK_SAMPLES, RATE_HZ, SAMPLE_BYTES, RecordedMicrophone
from kgdfa.hand import FloatArray

LIST = "recordings.csv"
COLUMNS = ("path", "stop", "group")
SNRS_DB = (20, 10, 5, 0)
MARGIN = RATE_HZ // 2  # of silence, or noise, before and after a word
MINUTE = 60 * RATE_HZ
SILENCE = bytes(RATE_HZ // 2 * SAMPLE_BYTES)  # after each recording, so that its last word ends


@dataclass(frozen=True, slots=True)
class Recording:
    """Samples at RATE_HZ, 16-bit, whether the word is in it, and what it is counted with."""

    group: str
    stop: bool
    samples: bytes


def synthetic_count(minutes: int) -> int:
    """How many `synthetic` makes."""
    spoken = sum(len(voices(Voices.TUNING, language)) * len(PHRASES[language]) for language in PHRASES)
    return spoken * (1 + len(SNRS_DB)) + minutes * len(noises(Voices.TUNING))


def synthetic(which: Voices, minutes: int, seed: int, every: int = 1) -> Iterator[Recording]:
    """Every phrase by every voice, alone and in one noise at each ratio; then so many minutes of each noise alone.

    every: use every so manieth voice. Raises AppError without espeak-ng.
    """
    rng = np.random.default_rng(seed)
    sounds = noises(which)
    for language, phrases in PHRASES.items():
        for phrase in phrases:
            for voice in voices(which, language)[::every]:
                yield from _spoken(phrase, language, voice, which, rng)
    for name, sound in sounds.items():
        for _ in range(minutes):
            yield Recording(f"{name}, without the word", stop=False, samples=pcm(sound(MINUTE, rng)))


def _spoken(phrase: Phrase, language: str, voice: str, which: Voices, rng: Generator) -> Iterator[Recording]:
    spoken = speak(phrase.text, voice, int(rng.integers(12, 24)) * 10, int(rng.integers(2, 8)) * 10)
    word = np.pad(levelled(spoken), MARGIN)
    kind = language if phrase.stop else f"{language}, {phrase.text}"
    yield Recording(kind + (", alone" if phrase.stop else ""), phrase.stop, pcm(word))
    for snr_db in SNRS_DB:
        names = list(noises(which)) if phrase.stop else [str(rng.choice(list(noises(which))))]
        name = names[int(rng.integers(len(names)))]
        noise = noises(which)[name](len(word), rng)
        yield Recording(
            kind + (f", {snr_db} dB over noise" if phrase.stop else ""), phrase.stop, pcm(mixed(word, noise, snr_db))
        )


def read_recordings(folder: Path) -> list[Recording]:
    """Those of a folder with recordings.csv (path,stop,group). Raises AppError."""
    file = folder / LIST
    lines = read_table(file, COLUMNS)
    if not lines:
        raise AppError(EvaluateFault.TABLE_EMPTY, file=file)
    return [_read(folder, line, number) for number, line in lines]


def _read(folder: Path, line: Row, number: int) -> Recording:
    if line["stop"] not in {"0", "1"}:
        raise AppError(EvaluateFault.ROW_STOP, file=folder / LIST, line=number, stop=line["stop"])
    path = folder / (line["path"] or "")
    microphone = RecordedMicrophone(path)
    parts: list[bytes] = []
    try:
        microphone.open()
        while True:
            parts.append(microphone.read())
    except HardwareError as error:
        if not parts:
            raise AppError(EvaluateFault.FILE_UNREADABLE, file=path, detail=error) from error
    finally:
        microphone.close()
    return Recording(line["group"] or "", line["stop"] == "1", b"".join(parts))


def keep(recordings: Iterator[Recording], folder: Path) -> Iterator[Recording]:
    """The same, each written as well, with the list at the end. Raises AppError."""
    lines = io.StringIO()
    table = csv.writer(lines)
    table.writerow(COLUMNS)
    for number, one in enumerate(recordings):
        made = io.BytesIO()
        with wave.open(made, "wb") as file:
            file.setnchannels(1)
            file.setsampwidth(SAMPLE_BYTES)
            file.setframerate(RATE_HZ)
            file.writeframes(one.samples)
        name = f"{number:05d}.wav"
        write_whole(folder / name, made.getvalue())
        table.writerow((name, int(one.stop), one.group))
        yield one
    write_whole(folder / LIST, lines.getvalue().encode())


def pcm(sound: FloatArray) -> bytes:
    """16-bit samples; louder ones are cut."""
    return (np.clip(sound, -1, 1) * 32767).astype("<i2").tobytes()


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
