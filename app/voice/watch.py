"""The console's end of the listening process: it can call one function, STOP by voice, and nothing else."""

from __future__ import annotations

import io
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from select import select

import msgspec

from app.voice.signals import ALIVE_TIMEOUT_S, STATE_OF, Signal, VoiceState
from hal.microphone import VoiceConfig

RESTART_S = 5.0  # how often a microphone that is missing is looked for
FIRST_BYTE_S = 60.0  # of a process that starts, and loads its model beside a session
NEXT_BYTE_S = 10.0  # one without a byte for so long is ended: PortAudio may wait for ever for an unplugged device
LISTENER: Sequence[str] = (sys.executable, "-m", "app.voice.listener")
_KNOWN = {one.value: one for one in Signal}


class VoiceStop:
    """Runs the listening process again whenever it ends or stands still, but for a recording that has ended or is none.

    `state` may be read from any thread.
    """

    def __init__(self, voice: VoiceConfig, stop: Callable[[], object], command: Sequence[str] = LISTENER) -> None:
        """stop: called in a thread of its own, once a word."""
        self._voice = voice
        self._stop = stop
        self._command = command
        self._state = VoiceState.STARTING
        self._received_s = time.monotonic()
        self._ending = threading.Event()
        self._child: subprocess.Popen[bytes] | None = None
        self._thread = threading.Thread(target=self._run, name="voice-stop", daemon=True)

    def start(self) -> None:
        """Begin to listen; a missing microphone or library is a state, not an error."""
        self._thread.start()

    @property
    def state(self) -> VoiceState:
        """As the process reported last; SILENT when it has reported nothing for too long, but for faults that stay."""
        recent = time.monotonic() - self._received_s < ALIVE_TIMEOUT_S
        if recent or self._state not in {VoiceState.LISTENING, VoiceState.NO_SOUND}:
            return self._state
        return VoiceState.SILENT

    def close(self) -> None:
        """End the process."""
        self._ending.set()
        child = self._child
        if child is not None:
            child.kill()
        if self._thread.is_alive():
            self._thread.join()

    def take(self, received: bytes) -> None:
        """What came through the pipe: every STOP stops, everything else is at most shown."""
        for number in received:
            one = _KNOWN.get(bytes([number]))
            if one is None:
                continue
            self._state, self._received_s = STATE_OF[one], time.monotonic()
            if one is Signal.STOP:
                self._stop()

    def _run(self) -> None:
        while not self._ending.is_set():
            with suppress(OSError):
                self._listen()
            if self._state in {VoiceState.RECORDING_ENDED, VoiceState.RECORDING_UNUSABLE}:
                return
            if self._state in {VoiceState.STARTING, VoiceState.LISTENING, VoiceState.NO_SOUND}:
                self._state = VoiceState.SILENT
            self._ending.wait(RESTART_S)

    def _listen(self) -> None:
        with subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        ) as child:
            self._child = child
            if self._ending.is_set():  # `close` has not seen it
                child.kill()
            assert child.stdin is not None
            assert isinstance(child.stdout, io.BufferedReader)
            with suppress(OSError):
                child.stdin.write(msgspec.json.encode(self._voice))
                child.stdin.close()
            limit_s = FIRST_BYTE_S
            while select([child.stdout], [], [], limit_s)[0] and (received := child.stdout.read1()):
                self.take(received)
                limit_s = NEXT_BYTE_S
            child.kill()
        self._child = None
