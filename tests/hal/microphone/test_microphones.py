"""Microphones: a file as one, PortAudio behind a fake, and what is said when something is missing."""

from __future__ import annotations

import sys
import wave
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from hal.errors import HardwareError, MicrophoneFault
from hal.microphone import BLOCK_SAMPLES, RATE_HZ, PortAudioMicrophone, RecordedMicrophone, VoiceConfig, make_microphone


def write_wav(path: Path, samples: bytes, rate_hz: int = RATE_HZ, channels: int = 1) -> Path:
    with wave.open(str(path), "wb") as file:
        file.setnchannels(channels)
        file.setsampwidth(2)
        file.setframerate(rate_hz)
        file.writeframes(samples)
    return path


def test_a_file_is_read_in_blocks_as_long_as_they_last_and_ends(tmp_path: Path) -> None:
    waits: list[None] = []
    samples = bytes(range(250)) * 20
    wanted = VoiceConfig(kind="recording", device=str(write_wav(tmp_path / "a.wav", samples)))
    microphone = make_microphone(wanted, lambda: waits.append(None))
    microphone.open()
    assert microphone.read() == samples[: 2 * BLOCK_SAMPLES]
    assert microphone.read() == samples[2 * BLOCK_SAMPLES :]
    with pytest.raises(HardwareError) as raised:
        microphone.read()
    assert raised.value.code is MicrophoneFault.RECORDING_ENDED
    assert len(waits) == 3
    microphone.close()
    microphone.close()


def test_a_recording_may_be_named_from_the_users_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    samples = bytes([1, 2]) * BLOCK_SAMPLES
    write_wav(tmp_path / "a.wav", samples)
    microphone = make_microphone(VoiceConfig(kind="recording", device="~/a.wav"), lambda: None)
    microphone.open()
    assert microphone.read() == samples
    microphone.close()


def test_a_recording_in_the_home_of_an_unknown_user_can_t_be_opened() -> None:
    microphone = make_microphone(VoiceConfig(kind="recording", device="~nobody-here/a.wav"), lambda: None)
    with pytest.raises(HardwareError) as raised:
        microphone.open()
    assert raised.value.code is MicrophoneFault.NOT_OPENED


@pytest.mark.parametrize("form", [(8000, 1), (RATE_HZ, 2)])
def test_another_format_is_refused(tmp_path: Path, form: tuple[int, int]) -> None:
    microphone = RecordedMicrophone(write_wav(tmp_path / "a.wav", bytes(800), *form))
    with pytest.raises(HardwareError) as raised:
        microphone.open()
    assert raised.value.code is MicrophoneFault.OTHER_FORMAT
    microphone.close()


@pytest.mark.parametrize("content", [None, b"", b"RIFF....no wave"])
def test_what_is_no_wav_file_is_refused_with_its_name(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "a.wav"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(HardwareError) as raised:
        RecordedMicrophone(path).open()
    assert raised.value.code is MicrophoneFault.NOT_OPENED
    assert raised.value.values["device"] == path


def test_a_recording_must_be_named() -> None:
    with pytest.raises(ValueError, match="path of a WAV file"):
        VoiceConfig(on=True, kind="recording")


class FaultError(Exception):
    """PortAudio's own."""


class Stream:
    """Of a PortAudio with one input, that can be unplugged."""

    unplugged = False

    def __init__(self, *, device: object, **form: object) -> None:
        if device == "loopback":
            raise ValueError("No input device matching 'loopback'")
        self.device, self.form, self.open = device, form, True

    def start(self) -> None:
        pass

    def read(self, count: int) -> tuple[bytearray, bool]:
        if self.unplugged:
            raise FaultError
        return bytearray(2 * count), False

    def close(self, *, ignore_errors: bool) -> None:
        self.open = False


@pytest.fixture
def library(monkeypatch: pytest.MonkeyPatch) -> Any:
    made = SimpleNamespace(RawInputStream=Stream, PortAudioError=FaultError)
    monkeypatch.setitem(sys.modules, "sounddevice", made)
    return made


@pytest.mark.usefixtures("library")
@pytest.mark.parametrize(("named", "device"), [("", None), ("3", 3), ("USB", "USB")])
def test_portaudio_gives_blocks_until_it_is_unplugged(named: str, device: object) -> None:
    microphone = PortAudioMicrophone(named)
    microphone.open()
    stream = microphone._stream
    assert stream.device == device
    assert stream.form == {"samplerate": RATE_HZ, "blocksize": BLOCK_SAMPLES, "channels": 1, "dtype": "int16"}
    assert microphone.read() == bytes(2 * BLOCK_SAMPLES)
    stream.unplugged = True
    with pytest.raises(HardwareError) as raised:
        microphone.read()
    assert raised.value.code is MicrophoneFault.GONE
    microphone.close()
    microphone.close()
    assert not stream.open


@pytest.mark.usefixtures("library")
def test_a_device_that_is_not_there_is_named() -> None:
    with pytest.raises(HardwareError) as raised:
        PortAudioMicrophone("loopback").open()
    assert raised.value.code is MicrophoneFault.NOT_OPENED
    assert raised.value.values["device"] == "loopback"


def test_without_the_extra_or_without_portaudio_it_says_which(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "sounddevice", None)
    with pytest.raises(HardwareError) as raised:
        PortAudioMicrophone().open()
    assert raised.value.code is MicrophoneFault.EXTRA_MISSING
    (tmp_path / "sounddevice.py").write_text("raise OSError('PortAudio library not found')\n")
    monkeypatch.delitem(sys.modules, "sounddevice")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(HardwareError) as raised:
        PortAudioMicrophone().open()
    assert raised.value.code is MicrophoneFault.NO_PORTAUDIO
