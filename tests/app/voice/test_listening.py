"""The listening process and the console's end of its pipe: STOP comes through, and nothing else can."""

from __future__ import annotations

import subprocess
import sys
import time
import wave
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.voice.listener import listen, signal_of
from app.voice.signals import ALIVE_TIMEOUT_S, Signal, VoiceState
from app.voice.spotter import KeywordSpotter
from app.voice.watch import VoiceStop
from hal.errors import HardwareError, MicrophoneFault
from hal.microphone import RATE_HZ, VoiceConfig, make_microphone

ON = VoiceConfig(on=True)
WORD, SOUND, SILENCE = b"\x01\x02", b"\x03\x04", b"\0\0"


class Blocks:
    """A microphone that gives these, and is then unplugged."""

    def __init__(self, *blocks: bytes) -> None:
        self.blocks = [*blocks]
        self.closed = False

    def open(self) -> None:
        if not self.blocks:
            raise HardwareError(MicrophoneFault.NO_PORTAUDIO)

    def read(self) -> bytes:
        if not self.blocks:
            raise HardwareError(MicrophoneFault.GONE, device="USB")
        return self.blocks.pop(0)

    def close(self) -> None:
        self.closed = True


class FindsWord:
    """A spotter whose word is one block."""

    def detect(self, samples: bytes) -> bool:
        return samples == WORD


def test_each_word_is_one_stop_and_silence_is_told_from_sound() -> None:
    reported: list[Signal] = []
    microphone = Blocks(SOUND, WORD, SILENCE, WORD)
    error = listen(microphone, FindsWord, reported.append)
    assert b"".join(one.value for one in reported) == b"llszls"
    assert (error.code, microphone.closed) == (MicrophoneFault.GONE, True)
    assert signal_of(error, ON) is Signal.NO_MICROPHONE


def test_what_is_missing_is_said_by_its_own_signal() -> None:
    ended = listen(Blocks(), lambda: pytest.fail("loaded for nothing"), lambda _: None)
    assert signal_of(ended, ON) is Signal.NO_PORTAUDIO
    assert signal_of(HardwareError(MicrophoneFault.EXTRA_MISSING), ON) is Signal.NO_EXTRA
    assert signal_of(HardwareError(MicrophoneFault.NOT_OPENED), ON) is Signal.NO_MICROPHONE


@pytest.mark.parametrize(
    ("rate_hz", "wanted"),
    [(None, Signal.RECORDING_UNUSABLE), (44_100, Signal.RECORDING_UNUSABLE), (RATE_HZ, Signal.RECORDING_ENDED)],
    ids=["missing", "of another rate", "as it has to be"],
)
def test_a_recording_that_is_missing_or_of_another_format_is_no_missing_microphone(
    tmp_path: Path, rate_hz: int | None, wanted: Signal
) -> None:
    path = tmp_path / "said.wav"
    if rate_hz is not None:
        with wave.open(str(path), "wb") as file:
            file.setnchannels(1)
            file.setsampwidth(2)
            file.setframerate(rate_hz)
            file.writeframes(SILENCE * 10)
    config = VoiceConfig(on=True, kind="recording", device=str(path))
    ended = listen(make_microphone(config, lambda: None), FindsWord, lambda _: None)
    assert signal_of(ended, config) is wanted


def test_the_spotter_without_the_extra_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pocketsphinx", None)
    with pytest.raises(HardwareError) as raised:
        KeywordSpotter()
    assert raised.value.code is MicrophoneFault.EXTRA_MISSING


@given(received=st.binary(max_size=200))
def test_whatever_comes_through_the_pipe_it_calls_stop_for_a_stop_and_does_nothing_else(received: bytes) -> None:
    calls: list[None] = []
    voice = VoiceStop(ON, lambda: calls.append(None))
    voice.take(received)
    assert len(calls) == received.count(Signal.STOP.value)
    assert voice.state in VoiceState


def test_a_microphone_that_stands_still_is_shown_a_fault_that_stays_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 100.0
    monkeypatch.setattr("app.voice.watch.time", type("", (), {"monotonic": staticmethod(lambda: now_s)}))
    voice = VoiceStop(ON, lambda: None)
    for one, later in (
        (Signal.LISTENS, VoiceState.SILENT),
        (Signal.NO_SOUND, VoiceState.SILENT),
        (Signal.NO_EXTRA, VoiceState.NO_EXTRA),
        (Signal.NO_MICROPHONE, VoiceState.NO_MICROPHONE),
    ):
        voice.take(one.value)
        before = voice.state
        now_s += ALIVE_TIMEOUT_S + 0.1
        assert (before is VoiceState.SILENT, voice.state) == (False, later)


def until(condition: Callable[[], object], limit_s: float = 20.0) -> None:
    end_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end_s, "in time"
        time.sleep(0.01)


def process(script: str) -> tuple[str, ...]:
    """A listening process of a few lines: it is given the configuration, and writes bytes."""
    return (sys.executable, "-c", f"import sys, time; sys.stdin.read(); out = sys.stdout.buffer; {script}")


def test_a_process_of_its_own_is_heard_and_ends_with_the_session() -> None:
    calls: list[None] = []
    endless = process("out.write(b'lls?l'); out.flush(); time.sleep(600)")
    voice = VoiceStop(ON, lambda: calls.append(None), endless)
    assert voice.state.name == "STARTING"  # by name: mypy takes a property for a value that stays
    voice.start()
    until(lambda: calls)
    assert voice.state.name == "LISTENING"
    child = voice._child
    assert child is not None
    voice.close()
    assert child.poll() is not None
    assert len(calls) == 1


@pytest.mark.parametrize(("script", "state"), [("pass", VoiceState.SILENT), ("out.write(b'e')", VoiceState.NO_EXTRA)])
def test_a_process_that_ends_is_a_state_and_no_error(script: str, state: VoiceState) -> None:
    voice = VoiceStop(ON, lambda: pytest.fail("nobody spoke"), process(script))
    voice.start()
    until(lambda: voice.state is state)
    voice.close()


@pytest.mark.parametrize(("limit", "script"), [("NEXT_BYTE_S", "out.write(b'l'); out.flush()"), ("FIRST_BYTE_S", "")])
def test_a_process_that_stands_still_is_replaced(monkeypatch: pytest.MonkeyPatch, limit: str, script: str) -> None:
    monkeypatch.setattr(f"app.voice.watch.{limit}", 0.2)
    monkeypatch.setattr("app.voice.watch.RESTART_S", 0.05)
    voice = VoiceStop(ON, lambda: pytest.fail("nobody spoke"), process(f"{script}; time.sleep(600)"))
    voice.start()
    children = list[subprocess.Popen[bytes]]()

    def replaced() -> bool:
        child = voice._child
        children.extend([child] if child is not None and child not in children else [])
        return len(children) > 1

    until(replaced)
    assert children[0].poll() is not None
    assert script or voice.state is VoiceState.SILENT
    voice.close()


@pytest.mark.parametrize(
    ("sent", "state"), [("lsr", VoiceState.RECORDING_ENDED), ("lsu", VoiceState.RECORDING_UNUSABLE)]
)
def test_a_recording_that_has_ended_or_is_none_is_not_played_again(
    monkeypatch: pytest.MonkeyPatch, sent: str, state: VoiceState
) -> None:
    monkeypatch.setattr("app.voice.watch.RESTART_S", 0.0)
    calls: list[None] = []
    voice = VoiceStop(ON, lambda: calls.append(None), process(f"out.write({sent.encode()!r})"))
    voice.start()
    voice._thread.join(20.0)
    assert not voice._thread.is_alive()
    assert (voice.state, len(calls)) == (state, 1)
    voice.close()


def test_a_program_that_is_missing_is_a_state_and_no_error() -> None:
    voice = VoiceStop(ON, lambda: pytest.fail("nobody spoke"), ("/nowhere/python",))
    voice.start()
    until(lambda: voice.state is VoiceState.SILENT)
    voice.close()


def test_the_real_process_without_the_extra_says_so_and_ends() -> None:
    hidden = "import sys; sys.modules['pocketsphinx'] = None; from app.voice.listener import main; main()"
    voice = VoiceStop(ON, lambda: pytest.fail("nobody spoke"), (sys.executable, "-c", hidden))
    voice.start()
    until(lambda: voice.state is VoiceState.NO_EXTRA)
    voice.close()


def test_a_microphone_that_is_plugged_in_later_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """PortAudio lists the devices once in a process."""
    plug = tmp_path / "plugged in"
    library = f"""
import os
listed = os.path.exists({str(plug)!r})
class PortAudioError(Exception): pass
class RawInputStream:
    def __init__(self, **form):
        if not listed: raise PortAudioError
    def start(self): pass
    def read(self, count): return bytes([1]) * 2 * count, False
    def close(self, ignore_errors): pass
"""
    (tmp_path / "sounddevice.py").write_text(library)
    script = f"""
import sys
sys.path.insert(0, {str(tmp_path)!r})
from app.voice import listener
listener.require_spotter = lambda: None
listener.KeywordSpotter = lambda: type("", (), {{"detect": lambda *_: False}})()
listener.main()
"""
    monkeypatch.setattr("app.voice.watch.RESTART_S", 0.05)
    voice = VoiceStop(ON, lambda: pytest.fail("nobody spoke"), (sys.executable, "-c", script))
    voice.start()
    until(lambda: voice.state is VoiceState.NO_MICROPHONE)
    plug.touch()
    until(lambda: voice.state is VoiceState.LISTENING)
    voice.close()
