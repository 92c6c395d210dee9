"""Which thresholds of the keyword spotter: recall and false stops of each keyword alone, on the voices for tuning.

    python tools/voice_thresholds.py [--minutes 3] [--every 4]

The rule: the smallest threshold with at most 20 false stops an hour in gait noise and talk. In music no threshold
keeps to that for 停 and still finds it. The figures of the chosen ones are of other voices: `rleex evaluate voice`.
"""

from __future__ import annotations

import argparse

from app.evaluate.voice.recordings import GroupResult, Recording, measure, synthetic
from app.evaluate.voice.speech import PHRASES, Voices
from app.voice.spotter import KeywordSpotter

EXPONENTS = {"stop": (-12, -9, -6, -3), "ting": (0, 2, 4, 6)}
LANGUAGE = {"stop": "en", "ting": "zh"}


def main() -> None:
    """Print a row for each threshold."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=int, default=3, help="of each noise without the word")
    parser.add_argument("--every", type=int, default=4, help="use every so manieth voice")
    given = parser.parse_args()
    recordings = list(synthetic(Voices.TUNING, given.minutes, seed=1, every=given.every))
    print("keyword  exponent  recall  alike that stop  false stops an hour: gait, talk  music")
    for word, exponents in EXPONENTS.items():
        for exponent in exponents:
            print(row(word, exponent, recordings), flush=True)


def row(word: str, exponent: int, recordings: list[Recording]) -> str:
    """Of one keyword with one threshold."""
    language = LANGUAGE[word]
    foreign = tuple(other for other in PHRASES if other != language)
    used = [one for one in recordings if not (one.stop and one.group.startswith(foreign))]
    results = measure(used, KeywordSpotter({word: exponent}))
    spoken = [one for one in results if one.stop]
    alike = [one for one in results if not one.stop and "without" not in one.group]
    noise = [one for one in results if "without" in one.group]
    music = [one for one in noise if one.group.startswith("music")]
    others = [one for one in noise if one not in music]
    return (
        f"{word:7}  {exponent:8}  {share(spoken):6.1%}  {share(alike):15.1%}  "
        f"{per_hour(others):34.1f}  {per_hour(music):5.1f}"
    )


def per_hour(results: list[GroupResult]) -> float:
    """Stops an hour of all of them."""
    return sum(one.stops for one in results) * 3600 / sum(one.seconds for one in results)


def share(results: list[GroupResult]) -> float:
    """Of the recordings that stopped."""
    return sum(one.stopped for one in results) / max(1, sum(one.recordings for one in results))


if __name__ == "__main__":
    main()
