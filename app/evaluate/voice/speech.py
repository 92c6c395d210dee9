"""Synthetic speech by espeak-ng: many voices, speeds and pitches, two languages. It is no person's speech."""

from __future__ import annotations

import io
import shutil
import subprocess
import wave
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
