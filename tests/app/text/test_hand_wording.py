"""Every code of the hand's chain and of profiles has its wording in both languages, with its values."""

from __future__ import annotations

import re
from enum import Enum

import pytest

from app.perception.camera import PerceptionNote
from app.perception.palm_calibration import PalmHint
from app.text.catalogue import knows, render, use_language
from kgdfa.button_state import PressCancel, PressHint
from kgdfa.errors import KgdfaFault
from kgdfa.features import FEATURES, Feature, Measure
from kgdfa.gesture import Decision, Explanation, Gesture
from kgdfa.gesture_needs import Condition
from kgdfa.press_zone import ZoneAssessment, press_zone
from kgdfa.published import Constraint, PublishedRules
from kgdfa.robust import Limit, RobustRules
from logs.reason import key_of, reason
from profiles.errors import ProfileFault
from profiles.palm import PalmFinding, ReferenceSource, explain_estimate, palm_estimate, reference_segment
from profiles.schema import DEMO_PATIENT
from tests.kgdfa.hands import STATES, drawn_hand

LATIN = re.compile("[A-Za-z]{2,}")
CODES: list[type[Enum]] = [
    *(Decision, Measure, Condition, Limit, Constraint, PressCancel, PressHint, KgdfaFault, ZoneAssessment),
    *(PerceptionNote, PalmHint, ProfileFault, PalmFinding, ReferenceSource),
]


@pytest.mark.parametrize("language", ["en", "zh"])
@pytest.mark.parametrize("kind", CODES)
def test_every_code_has_a_wording(kind: type[Enum], language: str) -> None:
    use_language(language)
    assert [member.name for member in kind if not knows(key_of(member))] == []


@pytest.mark.parametrize("feature", FEATURES, ids=lambda feature: feature.name)
def test_every_measure_is_rendered_whole_in_chinese(feature: Feature) -> None:
    use_language("zh")
    beyond = Explanation(Limit.ABOVE_SHARE, {"measure": feature.explain(), "value": 0.74, "limit": 0.53})
    text = render(Explanation(Decision.NOT, {"gesture": Gesture.FOUR, "measure": beyond}))
    assert text.startswith("不是 4：")
    assert text.endswith(" 0.74 > 0.53")
    assert not LATIN.search(text), text


@pytest.mark.parametrize("rules", [PublishedRules(), RobustRules()], ids=lambda rules: rules.name)
@pytest.mark.parametrize("states", [*STATES.values(), "oofof", "fffoo"])
def test_every_explanation_of_a_hand_is_rendered(rules: PublishedRules | RobustRules, states: str) -> None:
    verdict = rules.classify(drawn_hand(states))
    use_language("zh")
    assert not LATIN.search(re.sub(r"love|rock", "", render(verdict.explanation)))
    use_language("en")
    assert "{" not in render(verdict.explanation)


def test_values_are_rendered_in_the_clinic_s_units() -> None:
    use_language("en")
    segment, estimate = reference_segment(DEMO_PATIENT), palm_estimate(DEMO_PATIENT)
    assert f"{segment.length_m * 100:.2f} cm (palm width {estimate.width_m * 100:.1f} cm)" in render(segment.explain())
    assert f"{estimate.width_m * 100:.1f} cm ±" in render(explain_estimate(estimate))
    zone = press_zone(focal_px=650, width_px=1280, height_px=720, reference_m=0.0615, palm_width_m=0.082)
    advice = render(reason(PerceptionNote.THRESHOLD_UNSUITED, threshold_m=0.1, zone=zone.explain()))
    assert "10 cm" in advice
    assert "Proposed threshold: 20 cm" in advice
