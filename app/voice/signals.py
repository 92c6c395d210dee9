"""What the listening process can say: one byte each, and nothing that moves."""

from __future__ import annotations

from enum import Enum

ALIVE_TIMEOUT_S = 3.0  # a block comes every 0.1 s; older than this the microphone is dead


class Signal(Enum):
    """A byte of the pipe; every other byte means nothing."""

    STOP = b"s"
    LISTENS = b"l"  # once for every block of samples
    NO_SOUND = b"z"  # a block of nothing but zeros: muted, or no microphone behind the plug
    NO_EXTRA = b"e"
    NO_PORTAUDIO = b"p"
    NO_MICROPHONE = b"m"
    RECORDING_ENDED = b"r"
    RECORDING_UNUSABLE = b"u"  # the file is missing, or of another format


class VoiceState(Enum):
    """What the console shows of it."""

    STARTING = "starting"
    LISTENING = "listening"
    NO_SOUND = "no sound"
    NO_EXTRA = "no extra"
    NO_PORTAUDIO = "no PortAudio"
    NO_MICROPHONE = "no microphone"
    RECORDING_ENDED = "recording ended"
    RECORDING_UNUSABLE = "recording unusable"
    SILENT = "silent"  # the process or its microphone stands still


STATE_OF = {
    Signal.STOP: VoiceState.LISTENING,
    Signal.LISTENS: VoiceState.LISTENING,
    Signal.NO_SOUND: VoiceState.NO_SOUND,
    Signal.NO_EXTRA: VoiceState.NO_EXTRA,
    Signal.NO_PORTAUDIO: VoiceState.NO_PORTAUDIO,
    Signal.NO_MICROPHONE: VoiceState.NO_MICROPHONE,
    Signal.RECORDING_ENDED: VoiceState.RECORDING_ENDED,
    Signal.RECORDING_UNUSABLE: VoiceState.RECORDING_UNUSABLE,
}
