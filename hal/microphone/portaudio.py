"""A microphone through PortAudio. Extra: rleex[voice]; the library itself is the system's (libportaudio2)."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from hal.errors import HardwareError, MicrophoneFault
from hal.microphone.protocol import BLOCK_SAMPLES, RATE_HZ


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
