"""The smallest change of a measure that means something, from literature; without a published one, none.

Those of walking were found in people without a device: beside an exoskeleton's walk they are a comparison only.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto


class ChangeKind(Enum):
    """What a change so large means."""

    IMPORTANT = auto()  # it goes with an improvement in daily life (minimal clinically important difference)
    DETECTABLE = auto()  # it is more than a repeated test varies (minimal detectable change)


class FoundIn(Enum):
    """In whom; the wording is the catalogue's."""

    SUBACUTE_STROKE = auto()
    CHRONIC_STROKE = auto()
    INCOMPLETE_SPINAL_CORD_INJURY = auto()
    CHRONIC_PAIN = auto()
    OLDER_AND_SUBACUTE_STROKE = auto()


@dataclass(frozen=True, slots=True, kw_only=True)
class SmallestChange:
    """Of one measure, in its own unit or as a share of it."""

    least: float
    relative: bool = False
    kind: ChangeKind
    found_in: FoundIn
    source: str

    def of(self, value: float) -> float:
        """In the measure's unit, where the measure was so large before."""
        return self.least * abs(value) if self.relative else self.least


_STEP_LENGTH = SmallestChange(  # of the paretic leg
    least=0.067,
    kind=ChangeKind.DETECTABLE,
    found_in=FoundIn.CHRONIC_STROKE,
    source="Kesar et al., Gait & Posture 33(2), 2011",
)

_PERERA = "Perera et al., Journal of the American Geriatrics Society 54(5), 2006, doi:10.1111/j.1532-5415.2006.00701.x"

# By field of Measures or SessionOutcomes, or by key of a guided test's measure. None is of a Timed Up and Go without
# a turn.
SMALLEST_CHANGES = {
    "speed_m_s": SmallestChange(
        least=0.16,
        kind=ChangeKind.IMPORTANT,
        found_in=FoundIn.SUBACUTE_STROKE,
        source="Tilson et al., Physical Therapy 90(2), 2010, doi:10.2522/ptj.20090079",
    ),
    "cadence_steps_min": SmallestChange(
        least=0.21,
        relative=True,
        kind=ChangeKind.DETECTABLE,
        found_in=FoundIn.INCOMPLETE_SPINAL_CORD_INJURY,
        source="Nair et al., Topics in Spinal Cord Injury Rehabilitation 18(3), 2012, doi:10.1310/sci1803-273",
    ),
    "step_length_left_m": _STEP_LENGTH,
    "step_length_right_m": _STEP_LENGTH,
    "ten_metre_speed": SmallestChange(
        least=0.05,
        kind=ChangeKind.IMPORTANT,
        found_in=FoundIn.OLDER_AND_SUBACUTE_STROKE,
        source=_PERERA,
    ),
    "six_minute_distance": SmallestChange(
        least=20,
        kind=ChangeKind.IMPORTANT,
        found_in=FoundIn.OLDER_AND_SUBACUTE_STROKE,
        source=_PERERA,
    ),
    "pain": SmallestChange(
        least=2,
        kind=ChangeKind.IMPORTANT,
        found_in=FoundIn.CHRONIC_PAIN,
        source="Farrar et al., Pain 94(2), 2001, doi:10.1016/S0304-3959(01)00349-9",
    ),
}
