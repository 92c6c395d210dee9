"""The gestures with which a patient may command, in the profile and its file."""

from __future__ import annotations

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kgdfa.gesture import Gesture
from profiles.errors import ProfileError, ProfileFault
from profiles.fields import violations
from profiles.files import decode, edit, encode
from profiles.schema import DEMO_PATIENT, GestureUsed, Profile

G = GestureUsed
VOCABULARIES = st.lists(st.sampled_from(G), unique=True, min_size=1).filter(
    lambda gestures: G.FIVE not in gestures or G.SIX in gestures
)


def test_the_profile_names_the_twelve_as_recognition_does() -> None:
    used = {one.name: one.value for one in GestureUsed}
    assert used == {one.name: one.value for one in Gesture}, "GestureUsed in profiles/schema.py"


def test_a_profile_without_a_vocabulary_commands_with_all_twelve(patient: Profile) -> None:
    text = "\n".join(line for line in encode(patient).splitlines() if not line.startswith("vocabulary"))
    assert decode(text, "old.toml").vocabulary == tuple(GestureUsed)
    assert f'vocabulary = "{" ".join(one.value for one in GestureUsed)}"' in encode(patient)


@given(VOCABULARIES)
def test_a_file_gives_back_every_vocabulary(gestures: list[GestureUsed]) -> None:
    profile = msgspec.structs.replace(DEMO_PATIENT, vocabulary=tuple(gestures))
    assert decode(encode(profile, encode(DEMO_PATIENT)), "") == profile


@pytest.mark.parametrize(
    ("gestures", "fault"),
    [
        ((), ProfileFault.VOCABULARY_EMPTY),
        ((G.ONE, G.TWO, G.ONE), ProfileFault.VOCABULARY_TWICE),
        ((G.ZERO, G.FIVE), ProfileFault.WALK_WITHOUT_END),
    ],
)
def test_a_vocabulary_that_means_nothing_or_can_not_end_a_walk_is_refused(
    gestures: tuple[GestureUsed, ...], fault: ProfileFault
) -> None:
    wrong = violations(msgspec.structs.replace(DEMO_PATIENT, vocabulary=gestures))
    assert [(one.field, one.code) for one in wrong] == [("vocabulary", fault)]


def test_it_is_typed_as_one_text(patient: Profile) -> None:
    assert edit(patient, {"vocabulary": "0 6 5"}).vocabulary == (G.ZERO, G.SIX, G.FIVE)
    assert edit(patient, {"vocabulary": "7"}).vocabulary == (G.SEVEN,)
    with pytest.raises(ProfileError, match="'ten'"):
        edit(patient, {"vocabulary": "0 ten"})
    with pytest.raises(ProfileError, match="VOCABULARY_EMPTY"):
        edit(patient, {"vocabulary": ""})


@pytest.mark.parametrize("vocabulary", ["", "0 6"])
def test_a_file_gives_back_evidence_without_gestures(vocabulary: str) -> None:
    text = f"""{encode(DEMO_PATIENT)}
[evidence]
proven_at = "2026-09-21T14:13:20Z"
model = ""
vocabulary = "{vocabulary}"
idle_frames = 0
idle_taken = 0
idle_at_most = 1.0
gestures = []
"""
    profile = msgspec.structs.replace(decode(text, ""), note="left side weak")
    assert profile.evidence is not None
    assert profile.evidence.vocabulary == tuple(map(GestureUsed, vocabulary.split()))
    assert decode(encode(profile, text), "") == profile
