"""The recordings that the voice stop is measured on, and what is counted."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.evaluate.harness import EvaluateFault
from app.evaluate.voice import recordings, speech
from app.evaluate.voice.recordings import Recording, keep, measure, pcm, read_recordings, synthetic, synthetic_count
from app.evaluate.voice.speech import PHRASES, Voices, gait, levelled, mixed, music, resampled, rms, voices
from app.system.errors import AppError
from app.text.catalogue import render
from hal.errors import HardwareError, MicrophoneFault
from hal.microphone import RATE_HZ

LOUD = 12_000


class FindsLoud:
    """A spotter that takes one loud block for the word."""

    def __init__(self) -> None:
        self.begun = 0

    def begin(self) -> None:
        self.begun += 1

    def detect(self, samples: bytes) -> bool:
        return bool((np.frombuffer(samples, "<i2") > LOUD).any())


def sound(*loud_at_s: float, length_s: float = 2.0) -> bytes:
    """Silence with loud samples."""
    samples = np.zeros(int(length_s * RATE_HZ), "<i2")
    samples[[int(at * RATE_HZ) for at in loud_at_s]] = LOUD + 1
    return samples.tobytes()


def test_recordings_are_counted_once_and_stops_each() -> None:
    found = [
        Recording("word", stop=True, samples=sound(0.5, 1.5)),
        Recording("word", stop=True, samples=sound()),
        Recording("noise", stop=False, samples=sound(0.1, 0.7, 1.9, length_s=36.0)),
    ]
    spotter = FindsLoud()
    steps: list[None] = []
    word, noise = measure(found, spotter, lambda: steps.append(None))  # type: ignore[arg-type]
    assert (word.recordings, word.stopped, word.stops, word.share) == (2, 1, 2, 0.5)
    assert (noise.stopped, noise.stops, noise.seconds, noise.per_hour) == (1, 3, 36.0, 300.0)
    assert (spotter.begun, len(steps)) == (3, 3)


def test_no_voice_is_in_both_halves_and_every_language_has_as_many() -> None:
    for language in PHRASES:
        tuning, held_out = (voices(which, language) for which in (Voices.TUNING, Voices.HELD_OUT))
        assert not set(tuning) & set(held_out)
        assert not {one.partition("+")[2] for one in tuning} & {one.partition("+")[2] for one in held_out}
        assert len(set(tuning)) == len(set(held_out)) == 10


@pytest.mark.parametrize("snr_db", [20, 0, -5])
def test_a_word_stands_out_of_the_noise_by_the_ratio(snr_db: float) -> None:
    rng = np.random.default_rng(3)
    word = np.pad(np.sin(np.arange(8000) * 0.1), 4000)
    noise = gait(len(word), rng)
    found = mixed(word, noise, snr_db)
    left = found - word
    assert 20 * np.log10(rms(word[4000:12000]) / rms(left)) == pytest.approx(snr_db, abs=0.2)


@pytest.mark.parametrize("made", [gait, music])
def test_noises_are_as_long_and_as_loud_as_asked_and_differ_by_seed(made: object) -> None:
    first, second = (made(3 * RATE_HZ, np.random.default_rng(seed)) for seed in (1, 2))  # type: ignore[operator]
    assert len(first) == 3 * RATE_HZ
    assert rms(first) == pytest.approx(0.08, rel=1e-6)
    assert not np.allclose(first, second)


def test_resampling_keeps_a_tone_and_cuts_what_has_no_place() -> None:
    at = np.arange(22050) / 22050
    tone = resampled(np.sin(2 * np.pi * 440 * at), 22050)
    assert len(tone) == RATE_HZ
    assert np.allclose(tone, np.sin(2 * np.pi * 440 * np.arange(RATE_HZ) / RATE_HZ), atol=1e-6)
    assert rms(resampled(np.sin(2 * np.pi * 10_000 * at), 22050)) < 1e-6


def test_synthetic_recordings_are_all_there_and_the_same_for_a_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    def tone(text: str, voice: str, speed: int, pitch: int) -> np.ndarray:
        return levelled(np.sin(np.arange(400) * (1 + len(text) + pitch + speed) / 100))

    monkeypatch.setattr(recordings, "speak", tone)
    monkeypatch.setattr("app.evaluate.voice.speech.speak", tone)
    monkeypatch.setattr(recordings, "MINUTE", 1600)
    monkeypatch.setattr(recordings, "MARGIN", 400)
    few = {language: (phrases[0], phrases[-1]) for language, phrases in PHRASES.items()}
    monkeypatch.setattr(recordings, "PHRASES", few)
    made = [*synthetic(Voices.HELD_OUT, 2, seed=5)]
    assert len(made) == synthetic_count(2)
    assert made == [*synthetic(Voices.HELD_OUT, 2, seed=5)]
    assert made != [*synthetic(Voices.HELD_OUT, 2, seed=6)]
    with_word = {one.group for one in made if one.stop}
    assert with_word == {f"{lang}, {how}" for lang in ("en", "zh") for how in ("alone", *(
        f"{snr} dB over noise" for snr in (20, 10, 5, 0)))}  # fmt: skip
    assert {"en, start", "zh, 台阶"} <= {one.group for one in made if not one.stop}


def test_what_is_kept_is_read_again(tmp_path: Path) -> None:
    made = [Recording("a", stop=True, samples=sound(0.5)), Recording("b", stop=False, samples=pcm(np.zeros(1600)))]
    assert [*keep(iter(made), tmp_path)] == made
    assert read_recordings(tmp_path) == made


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (None, EvaluateFault.FILE_UNREADABLE),
        ("path,group\n", EvaluateFault.TABLE_COLUMNS),
        ("path,stop,group\n", EvaluateFault.TABLE_EMPTY),
        ("path,stop,group\na.wav,yes,x\n", EvaluateFault.ROW_STOP),
        ("path,stop,group\na.wav,1,x\n", EvaluateFault.FILE_UNREADABLE),
        ("path,stop,group\na.wav,1\n", EvaluateFault.ROW_FIELDS),
    ],
)
def test_a_bad_list_is_one_sentence(tmp_path: Path, text: str | None, fault: EvaluateFault) -> None:
    if text is not None:
        (tmp_path / "recordings.csv").write_text(text)
    with pytest.raises(AppError) as raised:
        read_recordings(tmp_path)
    assert raised.value.code is fault
    assert "Fault." not in render(raised.value)
    assert str(tmp_path) in str(raised.value.values["file"])


def test_without_espeak_or_the_extra_the_command_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pocketsphinx", None)
    done = CliRunner().invoke(cli, ["evaluate", "voice"])
    assert isinstance(done.exception, HardwareError)
    assert done.exception.code is MicrophoneFault.EXTRA_MISSING
    monkeypatch.setitem(sys.modules, "pocketsphinx", ModuleType("pocketsphinx"))
    monkeypatch.setattr(speech, "ESPEAK", "no-such-program")
    done = CliRunner().invoke(cli, ["evaluate", "voice"])
    assert isinstance(done.exception, AppError)
    assert done.exception.code is EvaluateFault.NO_SPEECH
