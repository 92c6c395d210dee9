"""Whether the voice stop listens stands on the session's screen and in the checks; switched off, nothing does."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import pytest

from app.console.live import LiveSession
from app.console.screens.checks import check_lines
from app.console.stop import StopSwitch
from app.console.widgets.status import status_line
from app.ipc.messages import OperatorKind
from app.text.catalogue import tr, use_language
from app.voice.signals import Signal, VoiceState
from hal.microphone import VoiceConfig
from testing.fake_host import FakeHost
from tests.app.console.test_sizes import KEYS, MOVING, READY, text_of


@pytest.mark.parametrize("language", ["en", "zh"])
@pytest.mark.parametrize("voice", VoiceState)
def test_it_is_shown_whether_it_listens_and_why_not(voice: VoiceState, language: str) -> None:
    use_language(language)
    state = replace(MOVING, voice=voice)
    listens = voice is VoiceState.LISTENING
    assert tr("status.voice" if listens else "status.no_voice") in text_of(status_line(state, 120, "i"))
    assert tr(voice) in text_of(check_lines(state, KEYS))


@pytest.mark.parametrize("width", [60, 80, 120, 200])
def test_switched_off_nothing_is_said_of_it(width: int) -> None:
    use_language("en")
    assert "voice" not in text_of(status_line(MOVING, width, "i"))
    assert "oice" not in text_of(check_lines(READY, KEYS))


def live(config: VoiceConfig, switch: StopSwitch | None) -> LiveSession:
    """A session with this voice."""
    setup = msgspec.structs.replace(READY.setup, config=msgspec.structs.replace(READY.setup.config, voice=config))
    return LiveSession(FakeHost(setup), switch)


def test_the_word_goes_the_way_of_the_stop_key_and_nothing_else_can_be_sent() -> None:
    session = live(VoiceConfig(on=True), StopSwitch())
    voice = session._voice
    assert voice is not None
    voice.take(bytes(range(256)) * 3)
    host = session.host
    assert isinstance(host, FakeHost)
    assert host.sent == [(OperatorKind.VOICE_STOP, None)] * 3
    voice.take(Signal.LISTENS.value)
    assert session.tick().voice is VoiceState.LISTENING


def test_off_or_only_watching_there_is_none() -> None:
    assert live(VoiceConfig(), StopSwitch())._voice is None
    assert live(VoiceConfig(on=True), None)._voice is None
    assert live(VoiceConfig(), StopSwitch()).tick().voice is None
