"""Synthetic sound: speech by espeak-ng in many voices and two languages, and what sounds in a training room.

Speech is no person's. Footfalls with drives, music and talk are mixed with a word.
"""

from __future__ import annotations

import io
import shutil
import subprocess
import wave
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache

import numpy as np

from app.evaluate.harness import EvaluateFault
from app.system.errors import AppError
from hal.microphone import RATE_HZ
from kgdfa.hand import FloatArray

ESPEAK = "espeak-ng"
TIMEOUT_S = 20.0
Generator = np.random.Generator
LEVEL = 0.08  # root mean square of what is spoken and of what sounds alone
_SCALE_HZ = tuple(220.0 * 2 ** (semitone / 12) for semitone in (0, 2, 4, 5, 7, 9, 11))


class Voices(Enum):
    """No voice is in both: the thresholds were chosen on one half, figures are of the other."""

    TUNING = "tuning"
    HELD_OUT = "held-out"


_ENGLISH = {
    Voices.TUNING: ("en-us", "en-gb-x-rp", "en-gb-x-gbclan", "en-029"),
    Voices.HELD_OUT: ("en-gb", "en-gb-scotland", "en-us-nyc", "en-gb-x-gbcwmd"),
}
_VARIANTS = {
    Voices.TUNING: ("m1", "m3", "m5", "f1", "f3", "Andy", "linda", "klatt", "Denis", "michel"),
    Voices.HELD_OUT: ("m2", "m4", "m7", "f2", "f4", "Alex", "Annie", "klatt2", "Michael", "steph"),
}


@dataclass(frozen=True, slots=True)
class Phrase:
    """What is said, and whether the word is in it."""

    text: str
    stop: bool


PHRASES = {
    "en": (
        *(Phrase(text, stop=True) for text in ("stop", "stop!", "please stop", "don't stop", "stop now")),
        *(Phrase(text, stop=False) for text in ("top", "shop", "step", "stock", "spot", "shot", "next step", "start")),
    ),
    "zh": (
        *(Phrase(text, stop=True) for text in ("停", "停！", "请停", "停下来", "停车")),
        *(Phrase(text, stop=False) for text in ("听", "等", "行", "定", "顶", "听我说", "走", "台阶")),
    ),
}
# What a therapist may say all day, without the word.
TALK = {
    "en": (
        "Shift your weight to the left, and take the next step when you are ready.",
        "Good. How did the last training feel? Is anything sore today?",
        "We will walk to the window and back, then you can sit down and rest.",
        "Keep your back straight and look ahead, the harness carries you.",
        "Your daughter called this morning, she will pick you up at four.",
        "Lift the right knee a little higher, we are getting close to the stairs.",
    ),
    "zh": (
        "请把重心移到左边，准备好了就迈下一步。",
        "很好。上次训练以后感觉怎么样？今天有哪里疼吗？",
        "我们走到窗边再走回来，然后您可以坐下休息。",
        "背挺直，看前方，吊带会托住您。",
        "您女儿早上打过电话，下午四点来接您。",
        "右膝再抬高一点，我们快到楼梯了。",
    ),
}


def voices(which: Voices, language: str) -> tuple[str, ...]:
    """espeak-ng's names of them."""
    if language == "zh":
        return tuple(f"cmn+{variant}" for variant in _VARIANTS[which])
    accents = _ENGLISH[which]
    return tuple(f"{accents[at % len(accents)]}+{variant}" for at, variant in enumerate(_VARIANTS[which]))


@lru_cache(maxsize=4096)
def speak(text: str, voice: str, speed: int, pitch: int) -> FloatArray:
    """(n,) samples at RATE_HZ between -1 and 1. speed: words a minute; pitch: 0 to 99. Raises AppError."""
    command = [ESPEAK, "-v", voice, "-s", str(speed), "-p", str(pitch), "--stdout", text]
    try:
        made = subprocess.run(command, capture_output=True, check=True, timeout=TIMEOUT_S).stdout
        with wave.open(io.BytesIO(made)) as file:
            rate_hz = file.getframerate()
    except (OSError, subprocess.SubprocessError, EOFError, wave.Error) as error:
        raise AppError(EvaluateFault.NO_SPEECH, program=ESPEAK) from error
    # The header of a stream names no length: what follows it are samples.
    samples = np.frombuffer(made[44 : len(made) - len(made) % 2], "<i2") / 32768.0
    return resampled(samples, rate_hz)


def resampled(samples: FloatArray, rate_hz: int) -> FloatArray:
    """At RATE_HZ, what lies above its half cut off."""
    wanted = round(len(samples) * RATE_HZ / rate_hz)
    spectrum = np.fft.rfft(samples)[: wanted // 2 + 1]
    return np.asarray(np.fft.irfft(spectrum, wanted) * (wanted / len(samples)), dtype=float)


def require_speech() -> None:
    """Raises AppError without espeak-ng."""
    if shutil.which(ESPEAK) is None:
        raise AppError(EvaluateFault.NO_SPEECH, program=ESPEAK)


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
