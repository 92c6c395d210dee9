"""Microphones: as `[voice]` of the configuration describes one, what each keeps, and the fake that reads a file.

The real one goes through PortAudio. Extra: rleex[voice]; the library itself is the system's (libportaudio2).
"""

from __future__ import annotations

import wave
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, Protocol

from msgspec import Struct

from hal.errors import HardwareError, MicrophoneFault
from logs.reading.regular import path_named

RATE_HZ = 16_000  # what the acoustic model was trained with
BLOCK_SAMPLES = 1600  # 0.1 s
SAMPLE_BYTES = 2


class VoiceConfig(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Whether "stop" and 停 from a microphone stop, and which microphone."""

    on: bool = False
    kind: Literal["microphone", "recording"] = "microphone"
    device: str = ""  # microphone: part of its name, or its number; empty: the system's. recording: path of a WAV file

    def __post_init__(self) -> None:
        if self.on and self.kind == "recording" and not self.device:
            raise ValueError("the voice of kind recording needs its device: the path of a WAV file")


class Microphone(Protocol):
    """One channel of 16-bit samples at RATE_HZ."""

    def open(self) -> None:
        """Raises HardwareError. May be called again after `close`."""

    def read(self) -> bytes:
        """The next BLOCK_SAMPLES samples, little-endian; waits for them. Raises HardwareError when it is gone."""

    def close(self) -> None:
        """Release it; may be called twice, and without `open`."""


class RecordedMicrophone:
    """A WAV file instead of a microphone; `wait` is called once a block, so that it takes as long as it was."""

    def __init__(self, path: Path, wait: Callable[[], object] = lambda: None) -> None:
        self._path = path
        self._wait = wait
        self._file: wave.Wave_read | None = None

    def open(self) -> None:
        """Raises HardwareError for what is no mono 16-bit WAV file of RATE_HZ."""
        try:
            self._file = wave.open(str(self._path), "rb")  # noqa: SIM115 - open until `close`
        except (OSError, EOFError, wave.Error) as error:
            detail = getattr(error, "strerror", None) or str(error) or "it ends too early"
            raise HardwareError(MicrophoneFault.NOT_OPENED, device=self._path, detail=detail) from error
        form = (self._file.getnchannels(), self._file.getsampwidth(), self._file.getframerate())
        if form != (1, SAMPLE_BYTES, RATE_HZ):
            raise HardwareError(MicrophoneFault.OTHER_FORMAT, file=self._path, rate_hz=RATE_HZ)

    def read(self) -> bytes:
        """Raises HardwareError at the file's end."""
        self._wait()
        samples = self._file.readframes(BLOCK_SAMPLES) if self._file else b""
        if not samples:
            raise HardwareError(MicrophoneFault.RECORDING_ENDED, file=self._path)
        return samples

    def close(self) -> None:
        """Release the file."""
        if self._file is not None:
            self._file.close()
            self._file = None


class PortAudioMicrophone:
    """The system's default input, or the one with this number or part of a name."""

    def __init__(self, device: str = "") -> None:
        self._device = device
        self._stream: Any = None

    def open(self) -> None:
        """Raises HardwareError naming what is missing."""
        library = load_library()
        device = int(self._device) if self._device.isdecimal() else self._device or None
        try:
            self._stream = library.RawInputStream(
                samplerate=RATE_HZ, blocksize=BLOCK_SAMPLES, channels=1, dtype="int16", device=device
            )
            self._stream.start()
        except (library.PortAudioError, ValueError) as error:
            self.close()
            named = self._device or "default"
            raise HardwareError(MicrophoneFault.NOT_OPENED, device=named, detail=str(error)) from error

    def read(self) -> bytes:
        """Samples that were lost before it (an overflow) are of no interest. Raises HardwareError."""
        try:
            samples, _ = self._stream.read(BLOCK_SAMPLES)
        except Exception as error:  # a PortAudioError, of a class that only the library knows
            raise HardwareError(MicrophoneFault.GONE, device=self._device or "default") from error
        return bytes(samples)

    def close(self) -> None:
        """Release the device."""
        if self._stream is not None:
            stream, self._stream = self._stream, None
            stream.close(ignore_errors=True)


def load_library() -> Any:
    """The library. Raises HardwareError without the extra, or without PortAudio."""
    try:
        return import_module("sounddevice")
    except ImportError as error:
        raise HardwareError(MicrophoneFault.EXTRA_MISSING) from error
    except OSError as error:
        raise HardwareError(MicrophoneFault.NO_PORTAUDIO) from error


def make_microphone(voice: VoiceConfig, wait: Callable[[], object]) -> Microphone:
    """The one that is configured, not open yet; wait: for the length of a block, between those of a recording."""
    if voice.kind == "recording":
        return RecordedMicrophone(path_named(voice.device), wait)
    return PortAudioMicrophone(voice.device)
