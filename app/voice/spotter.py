"""Finds "stop" and 停 in speech: PocketSphinx's keyword search with the English acoustic model of its package.

The model knows no Chinese. 停 is spelt with English phones (T IH NG), which say nothing of its tone: 听 is the same
keyword. Both find a word within others, so "don't stop" is a stop, and so is 停车.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any

from hal.errors import HardwareError, MicrophoneFault
from hal.microphone import RATE_HZ

# Phones of the CMU dictionary. The first vowel of "stop" is long in America, short and round in Britain.
PHONES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"stop": ("S T AA P", "S T AO P"), "ting": ("T IH NG", "T IY NG")}
)
# How much likelier than any phones the keyword must be; `tools/voice_thresholds.py` on the voices for tuning.
THRESHOLD_EXPONENTS: Mapping[str, int] = MappingProxyType({"stop": -6, "ting": 2})


class KeywordSpotter:
    """Takes samples as they come."""

    def __init__(self, exponents: Mapping[str, int] = THRESHOLD_EXPONENTS) -> None:
        """exponents: of ten, by keyword; only these are searched. Raises HardwareError without the extra."""
        library = require_spotter()
        spellings = [
            f"{word}{f'({number})' if number > 1 else ''} {phones}"
            for word in exponents
            for number, phones in enumerate(PHONES[word], start=1)
        ]
        with tempfile.TemporaryDirectory(prefix="rleex-voice-") as folder:
            dictionary, keys = Path(folder, "words.dict"), Path(folder, "keys.list")
            dictionary.write_text("\n".join(spellings) + "\n")
            keys.write_text("".join(f"{word} /1e{exponent}/\n" for word, exponent in exponents.items()))
            self._decoder: Any = library.Decoder(
                hmm=str(Path(library.get_model_path(), "en-us", "en-us")),
                dict=str(dictionary),
                kws=str(keys),
                samprate=float(RATE_HZ),
                loglevel="FATAL",
            )
        self._decoder.start_utt()

    def detect(self, samples: bytes) -> bool:
        """Whether a keyword has ended in these samples, 16-bit at RATE_HZ."""
        self._decoder.process_raw(samples, False, False)
        if self._decoder.hyp() is None:
            return False
        self.begin()
        return True

    def begin(self) -> None:
        """Forget what came before: the word was found, or another recording begins."""
        self._decoder.end_utt()
        self._decoder.start_utt()


def require_spotter() -> Any:
    """The library. Raises HardwareError without the extra."""
    try:
        return import_module("pocketsphinx")
    except ImportError as error:
        raise HardwareError(MicrophoneFault.EXTRA_MISSING) from error
