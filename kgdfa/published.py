"""The paper's rule set, literally: Table 2 with hulls and angles on the image, pixels as printed.

Where the text is open (which vectors an angle takes, which hull) the reading stands in `hand`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum

import numpy as np
from numpy.typing import NDArray

from kgdfa.gesture import Decision, Explanation, Finger, FingerState, Gesture, Verdict, fingers_in
from kgdfa.hand import INNER_HULL, OUTER_HULL, TIPS, FloatArray, Hand, Keypoint, apart, finger_angles_deg, tip_depths

SPREAD_PX = 100.0  # Table 2, gestures 6 and 8
PINCH_RATIO = 2.0  # Eq. 3, gesture 7
BENT_DEG = (53.0, 65.0, 65.0, 65.0, 49.0)  # thumb to pinky; gestures 1, 5 and 9 have forefingers of their own
MARGIN_DEG = 30.0  # an angle this far on the right side of its threshold leaves no doubt
MARGIN_SHARE = 0.25  # the same for a length, as a share of its threshold


class Extra(IntEnum):
    """The column of Table 2 for distances between tips; its value is the place in `Measures.lengths`."""

    NONE = 0
    SPREAD_PINKY = 1  # P(4, 20) > 100 px
    SPREAD_FORE = 2  # P(4, 8) > 100 px
    PINCH = 3  # Eq. 3: P(4, 12) / P(8, 12) < 2


class Constraint(Enum):
    """A constraint of Table 2 as measured: the code of an explanation."""

    TIP_OUTSIDE_INNER = "tip outside inner hull"  # tip: its keypoint
    TIP_INSIDE_INNER = "tip inside inner hull"
    TIP_OUTSIDE_OUTER = "tip outside outer hull"
    TIP_INSIDE_OUTER = "tip inside outer hull"
    FINGER_OPEN = "finger open"  # finger, value_deg, limit_deg
    FINGER_BENT = "finger bent"
    TIPS_APART = "tips apart"  # first, second: their keypoints; length_px, limit_px
    TIPS_NEAR = "tips near"
    TIPS_UNPINCHED = "tips unpinched"  # ratio, limit: P(4, 12) / P(8, 12)
    TIPS_PINCHED = "tips pinched"


# Fingertips in the hull's order (inner, outer), inside or outside.
_TIP_CODES = (
    (Constraint.TIP_INSIDE_INNER, Constraint.TIP_OUTSIDE_INNER),
    (Constraint.TIP_INSIDE_OUTER, Constraint.TIP_OUTSIDE_OUTER),
)
_SPREAD_TIPS = {Extra.SPREAD_PINKY: Keypoint.PINKY_TIP, Extra.SPREAD_FORE: Keypoint.INDEX_TIP}
_MAX_RATIO = 10.0  # of Eq. 3, as shown


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """A line of Table 2. outside: the fingertips outside the outer hull, all others inside; None: all five
    inside the inner hull. opened: fingers above their angle's threshold, all others at or below it.
    """

    gesture: Gesture
    outside: tuple[Finger, ...] | None
    opened: tuple[Finger, ...]
    fore_deg: float = BENT_DEG[Finger.FORE]
    extra: Extra = Extra.NONE


@dataclass(frozen=True, slots=True, kw_only=True)
class Measures:
    """What Table 2 measures: depths of the tips in both hulls (2, 5) px, angles (5,) deg, the reference segment px,
    and by `Extra` P(4,20) px, P(4,8) px and the ratio of Eq. 3, (4,).
    """

    depths_px: FloatArray
    angles_deg: FloatArray
    reference_px: float
    lengths: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Checks:
    """Every constraint on one hand, (12, 11): five tips, five angles, the extra. A margin is in units beyond
    which there is no doubt; negative ones don't hold.
    """

    holds: NDArray[np.bool_]
    margins: FloatArray

    @property
    def scores(self) -> FloatArray:
        """(12,): a line that holds gets 0.5 to 1 by its smallest margin, another less, by how many hold."""
        held = 0.5 + 0.5 * np.clip(self.margins.min(axis=1), 0.0, 1.0)
        scores: FloatArray = np.where(self.holds.all(axis=1), held, 0.5 * self.holds.mean(axis=1))
        return scores


def _row(gesture: Gesture, fore_deg: float = 160.0, extra: Extra = Extra.NONE) -> Row:
    """A line of Table 2; what the fingers do stands in `gesture`."""
    tips_out = fingers_in(gesture, FingerState.OPEN, FingerState.HOOKED, FingerState.PINCHED)
    return Row(
        gesture=gesture,
        outside=tips_out or None,
        opened=fingers_in(gesture, FingerState.OPEN, FingerState.PINCHED),
        fore_deg=fore_deg,
        extra=extra,
    )


TABLE_2: tuple[Row, ...] = (
    _row(Gesture.ZERO, BENT_DEG[Finger.FORE]),
    _row(Gesture.ONE),
    _row(Gesture.TWO),
    _row(Gesture.THREE),
    _row(Gesture.FOUR),
    _row(Gesture.FIVE, 170.0),
    _row(Gesture.SIX, BENT_DEG[Finger.FORE], Extra.SPREAD_PINKY),
    _row(Gesture.SEVEN, extra=Extra.PINCH),
    _row(Gesture.EIGHT, extra=Extra.SPREAD_FORE),
    _row(Gesture.NINE, 120.0),
    _row(Gesture.LOVE),
    _row(Gesture.ROCK),
)


_OUTSIDE = np.array([[finger in (row.outside or ()) for finger in Finger] for row in TABLE_2])
_OPEN = np.array([[finger in row.opened for finger in Finger] for row in TABLE_2])
_HULL = np.array([0 if row.outside is None else 1 for row in TABLE_2])
_LIMITS_DEG = np.array([[BENT_DEG[0], row.fore_deg, *BENT_DEG[2:]] for row in TABLE_2])
_EXTRA = np.array([row.extra for row in TABLE_2])


def measure(hand: Hand) -> Measures:
    """Everything that Table 2 measures, from the keypoints on the image."""
    points = hand.image_px
    short = apart(points, Keypoint.INDEX_TIP, Keypoint.MIDDLE_TIP)
    long = apart(points, Keypoint.THUMB_TIP, Keypoint.MIDDLE_TIP)
    spread_pinky = apart(points, Keypoint.THUMB_TIP, Keypoint.PINKY_TIP)
    spread_fore = apart(points, Keypoint.THUMB_TIP, Keypoint.INDEX_TIP)
    ratio = long / short if short > 0 else np.inf
    return Measures(
        depths_px=tip_depths(points, INNER_HULL, OUTER_HULL),
        angles_deg=finger_angles_deg(points),
        reference_px=hand.reference_px,
        lengths=np.array([0.0, spread_pinky, spread_fore, ratio]),
    )


def check(measures: Measures) -> Checks:
    """Every line of Table 2 against one hand."""
    depths = measures.depths_px[_HULL]
    beyond_deg = measures.angles_deg - _LIMITS_DEG
    extra_holds, extra_margins = _check_extras(measures.lengths)
    tip_scale = MARGIN_SHARE * max(measures.reference_px, 1e-9)
    tips_hold, angles_hold = (depths < 0) == _OUTSIDE, (beyond_deg > 0) == _OPEN
    margins = [
        np.where(tips_hold, 1, -1) * np.abs(depths) / tip_scale,
        np.where(angles_hold, 1, -1) * np.abs(beyond_deg) / MARGIN_DEG,
        extra_margins[_EXTRA, None],
    ]
    return Checks(
        holds=np.hstack([tips_hold, angles_hold, extra_holds[_EXTRA, None]]),
        margins=np.hstack(margins),
    )


def _check_extras(lengths: FloatArray) -> tuple[NDArray[np.bool_], FloatArray]:
    """Whether each `Extra` holds and by how much, (4,) each."""
    spread_px, ratio = lengths[1:3], lengths[3]
    holds = np.array([True, *(spread_px > SPREAD_PX), ratio < PINCH_RATIO])
    spread = (spread_px - SPREAD_PX) / (MARGIN_SHARE * SPREAD_PX)
    pinch = (PINCH_RATIO - min(ratio, 10.0)) / (MARGIN_SHARE * PINCH_RATIO)
    return holds, np.array([1.0, *spread, pinch])


def _explain(line: int, column: int, measures: Measures) -> Explanation:
    """One constraint of one line as measured."""
    if column < 5:
        outside = bool(measures.depths_px[_HULL[line], column] < 0)
        return Explanation(_TIP_CODES[_HULL[line]][outside], {"tip": int(TIPS[column])})
    if column < 10:
        finger, limit_deg = Finger(column - 5), float(_LIMITS_DEG[line, column - 5])
        angle_deg = float(measures.angles_deg[finger])
        code = Constraint.FINGER_OPEN if angle_deg > limit_deg else Constraint.FINGER_BENT
        return Explanation(code, {"finger": finger, "value_deg": angle_deg, "limit_deg": limit_deg})
    extra = TABLE_2[line].extra
    length = float(measures.lengths[extra])
    if extra is Extra.PINCH:
        code = Constraint.TIPS_PINCHED if length < PINCH_RATIO else Constraint.TIPS_UNPINCHED
        return Explanation(code, {"ratio": min(length, _MAX_RATIO), "limit": PINCH_RATIO})
    code = Constraint.TIPS_APART if length > SPREAD_PX else Constraint.TIPS_NEAR
    tips = {"first": int(Keypoint.THUMB_TIP), "second": int(_SPREAD_TIPS[extra])}
    return Explanation(code, {**tips, "length_px": length, "limit_px": SPREAD_PX})


class PublishedRules:
    """Table 2 as a RuleSet."""

    name = "published"

    def predict_proba(self, hand: Hand) -> FloatArray:
        """Confidence in each gesture, (12,) in the order of `Gesture`; 0.5 and above: the line holds."""
        return check(measure(hand)).scores

    def classify(self, hand: Hand) -> Verdict:
        """The one line that holds, or none with the constraint that the nearest line fails by most."""
        measures = measure(hand)
        checks = check(measures)
        scores = checks.scores
        best = int(np.lexsort((checks.margins.min(axis=1), scores))[-1])
        row, held = TABLE_2[best], bool(checks.holds[best].all())
        asked = checks.margins[best, : None if row.extra else -1]  # a line without an extra is not decided by one
        failing = np.where(checks.holds[best, : len(asked)], np.inf, asked)
        column = int(np.argmin(asked if held else failing))
        decision = Decision.CLOSEST if held else Decision.NOT
        return Verdict(
            gesture=row.gesture if held else None,
            confidence=float(scores[best]),
            explanation=Explanation(decision, {"gesture": row.gesture, "measure": _explain(best, column, measures)}),
        )
