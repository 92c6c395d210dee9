"""The microphone as `[voice]` of the configuration describes it."""

from __future__ import annotations

from typing import Literal

from msgspec import Struct


class VoiceConfig(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Whether "stop" and 停 from a microphone stop, and which microphone."""

    on: bool = False
    kind: Literal["microphone", "recording"] = "microphone"
    device: str = ""  # microphone: part of its name, or its number; empty: the system's. recording: path of a WAV file

    def __post_init__(self) -> None:
        if self.on and self.kind == "recording" and not self.device:
            raise ValueError("the voice of kind recording needs its device: the path of a WAV file")
