"""The microphone as `[voice]` of the configuration describes it, what each keeps, and the fake that reads a file."""

from __future__ import annotations

import wave
from collections.abc import Callable
from pathlib import Path
from typing import Literal, Protocol

from msgspec import Struct

from hal.errors import HardwareError, MicrophoneFault

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
            raise HardwareError(MicrophoneFault.GONE, device=self._path)
        return samples

    def close(self) -> None:
        """Release the file."""
        if self._file is not None:
            self._file.close()
            self._file = None


def make_microphone(voice: VoiceConfig, wait: Callable[[], object]) -> Microphone:
    """The one that is configured, not open yet; wait: for the length of a block, between those of a recording."""
    if voice.kind == "recording":
        return RecordedMicrophone(Path(voice.device), wait)
    from hal.microphone.portaudio import PortAudioMicrophone

    return PortAudioMicrophone(voice.device)
