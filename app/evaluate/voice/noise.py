"""What sounds in a training room, synthesised: footfalls with drives, music, talk; and the mixture with a word."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from app.evaluate.voice.speech import TALK, Voices, speak, voices
from hal.microphone import RATE_HZ
from kgdfa.hand import FloatArray

Generator = np.random.Generator
LEVEL = 0.08  # root mean square of what is spoken and of what sounds alone
_SCALE_HZ = tuple(220.0 * 2 ** (semitone / 12) for semitone in (0, 2, 4, 5, 7, 9, 11))


def gait(length: int, rng: Generator) -> FloatArray:
    """(length,) Footfalls once or twice a second, the whine of drives, and the room."""
    time_s = np.arange(length) / RATE_HZ
    sound = 0.1 * smoothed(rng.normal(size=length), 20)
    at, cadence_hz = rng.uniform(0, 0.5), rng.uniform(0.8, 2.0)
    while at < time_s[-1]:
        begin = int(at * RATE_HZ)
        thud = smoothed(rng.normal(size=int(0.12 * RATE_HZ)), int(rng.integers(4, 30)))
        thud *= np.exp(-np.arange(len(thud)) / (0.02 * RATE_HZ)) * rng.uniform(3, 8)
        end = min(length, begin + len(thud))
        sound[begin:end] += thud[: end - begin]
        at += rng.normal(1, 0.08) / cadence_hz
    speed = 1 + 0.5 * np.sin(2 * np.pi * cadence_hz / 2 * time_s)
    whine = np.cumsum(rng.uniform(200, 600) * speed) / RATE_HZ
    return levelled(sound + 0.15 * sum(np.sin(2 * np.pi * order * whine) / order for order in (1, 2, 3, 5)))


def music(length: int, rng: Generator) -> FloatArray:
    """(length,) Plucked chords, a melody and a beat at one speed."""
    beat = int(RATE_HZ * 60 / rng.uniform(70, 140))
    sound = np.zeros(length + 4 * beat)
    for number, begin in enumerate(range(0, length, beat)):
        root = int(rng.integers(len(_SCALE_HZ)))
        tones = [_SCALE_HZ[(root + step) % len(_SCALE_HZ)] / 2 for step in (0, 2, 4)] if number % 4 == 0 else []
        tones.append(_SCALE_HZ[int(rng.integers(len(_SCALE_HZ)))] * 2)
        for tone_hz in tones:
            span = np.arange(min(3 * beat, len(sound) - begin)) / RATE_HZ
            sound[begin : begin + len(span)] += sum(
                np.sin(2 * np.pi * tone_hz * order * span) * np.exp(-span * order * 2) / order for order in (1, 2, 3, 4)
            )
        drum = rng.normal(size=beat // 4) * np.exp(-np.arange(beat // 4) / (0.02 * RATE_HZ))
        sound[begin : begin + len(drum)] += drum * (2.0 if number % 2 else 0.7)
    return levelled(sound[:length])


def talk(length: int, rng: Generator, which: Voices) -> FloatArray:
    """(length,) One voice after the other, both languages, the word never among it."""
    parts: list[FloatArray] = []
    total = 0
    while total < length:
        language = str(rng.choice(list(TALK)))
        voice = str(rng.choice(voices(which, language)))
        spoken = speak(
            str(rng.choice(TALK[language])), voice, int(rng.integers(13, 22)) * 10, int(rng.integers(2, 8)) * 10
        )
        parts += [levelled(spoken), np.zeros(int(rng.uniform(0.2, 0.8) * RATE_HZ))]
        total += len(parts[-1]) + len(parts[-2])
    return levelled(np.concatenate(parts)[:length])


def noises(which: Voices) -> dict[str, Callable[[int, Generator], FloatArray]]:
    """By name."""
    return {"gait": gait, "music": music, "talk": lambda length, rng: talk(length, rng, which)}


def mixed(word: FloatArray, noise: FloatArray, snr_db: float) -> FloatArray:
    """The word in the noise, which is so much weaker than the word is while it is spoken."""
    spoken = word[np.abs(word) > 0.01 * np.abs(word).max()]
    gain = rms(spoken) / max(rms(noise), 1e-9) / 10 ** (snr_db / 20)
    return np.asarray(word + gain * noise, dtype=float)


def levelled(sound: FloatArray) -> FloatArray:
    """At LEVEL."""
    return np.asarray(sound * (LEVEL / max(rms(sound), 1e-9)), dtype=float)


def rms(sound: FloatArray) -> float:
    """Root mean square; 0 of nothing."""
    return float(np.sqrt(np.mean(np.square(sound)))) if len(sound) else 0.0


def smoothed(sound: FloatArray, length: int) -> FloatArray:
    """A moving mean: less of the high frequencies."""
    return np.convolve(sound, np.ones(length) / np.sqrt(length), mode="same")
