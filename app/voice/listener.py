"""The listening process: a microphone and a keyword spotter at one end of a pipe that carries single bytes.

It has no key of the session and no link to control. What it hears stays here: no sound is stored or sent.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable
from typing import Protocol

import msgspec

from app.voice.signals import Signal
from app.voice.spotter import KeywordSpotter, require_spotter
from hal.errors import HardwareError, MicrophoneFault
from hal.microphone import BLOCK_SAMPLES, RATE_HZ, Microphone, VoiceConfig, make_microphone

_OF_FAULT = {
    MicrophoneFault.EXTRA_MISSING: Signal.NO_EXTRA,
    MicrophoneFault.NO_PORTAUDIO: Signal.NO_PORTAUDIO,
    MicrophoneFault.RECORDING_ENDED: Signal.RECORDING_ENDED,
}


class Spotter(Protocol):
    """What finds the word."""

    def detect(self, samples: bytes) -> bool:
        """Whether it has ended in these samples."""


def listen(
    microphone: Microphone, make_spotter: Callable[[], Spotter], report: Callable[[Signal], object]
) -> HardwareError:
    """Report what is heard, block by block, until the microphone is gone; the error that ended it."""
    try:
        microphone.open()
        spotter = make_spotter()  # it loads for a while, for nothing where there is no microphone
        while True:
            samples = microphone.read()
            report(Signal.LISTENS if any(samples) else Signal.NO_SOUND)
            if spotter.detect(samples):
                report(Signal.STOP)
    except HardwareError as error:
        return error
    finally:
        microphone.close()


def signal_of(error: HardwareError, voice: VoiceConfig) -> Signal:
    """What is reported of a microphone that is not there."""
    other = Signal.RECORDING_UNUSABLE if voice.kind == "recording" else Signal.NO_MICROPHONE
    return _OF_FAULT.get(error.code, other)  # type: ignore[call-overload, no-any-return]


def main() -> None:
    """Standard input: the configuration as JSON. Standard output: signals, until nobody reads them.

    It ends without a microphone, and is started again: PortAudio lists the devices only once in a process.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # the console has ended
    voice = msgspec.json.decode(sys.stdin.buffer.read(), type=VoiceConfig)
    pipe = os.dup(1)
    os.dup2(2, 1)  # native libraries print what they please

    def report(what: Signal) -> None:
        os.write(pipe, what.value)

    microphone = make_microphone(voice, lambda: time.sleep(BLOCK_SAMPLES / RATE_HZ))
    try:
        require_spotter()  # what is not installed is said before what is not plugged in
        ended = listen(microphone, KeywordSpotter, report)
    except HardwareError as error:
        ended = error
    report(signal_of(ended, voice))


if __name__ == "__main__":
    main()
