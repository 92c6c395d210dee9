"""The whole chain of a mode, from an image to the button, for a person whose palm is known by ruler."""

from __future__ import annotations

from typing import Any

from app.perception.pipeline import RANGES, RULES
from hal.cameras.camera import Intrinsics
from hal.cameras.digital_hand.render import Person
from kgdfa.button_state import ButtonMode, ButtonPlace
from kgdfa.depth import DepthRange
from kgdfa.distance import DistanceChoice
from kgdfa.hand import Hand
from kgdfa.pipeline import Detector, Pipeline
from kgdfa.preprocess import Image

THRESHOLD_M = 0.20
CAMERAS = ("monocular", "D435i")
# By which distance the button is pressed, of a camera and a mode.
CHOICES = {
    ("monocular", "published"): DistanceChoice.MONOCULAR,
    ("monocular", "robust"): DistanceChoice.MONOCULAR,
    ("D435i", "published"): DistanceChoice.DEPTH,
    ("D435i", "robust"): DistanceChoice.BOTH,
}


class Replay:
    """A detector that repeats what another one has found, so that both modes get the same hands."""

    def __init__(self) -> None:
        self.hands: tuple[Hand, ...] = ()

    def detect(self, image_bgr: Image, captured_ns: int) -> tuple[Hand, ...]:  # noqa: ARG002 - the protocol's
        """The hands set before."""
        return self.hands


def replay_pipeline(
    mode: str, person: Person, lens: Intrinsics, threshold_m: float = THRESHOLD_M, **chosen: Any
) -> tuple[Replay, Pipeline]:
    """The mode's whole chain behind a `Replay`. chosen: as `Pipeline` takes it."""
    replay = Replay()
    return replay, chain(mode, person, lens, replay, threshold_m, **chosen)


def chain(
    mode: str,
    person: Person,
    lens: Intrinsics,
    detector: Detector,
    threshold_m: float = THRESHOLD_M,
    **chosen: Any,
) -> Pipeline:
    """The mode's whole chain for a person whose palm is known by ruler. chosen: as `Pipeline` takes it."""
    reference_m, centre_px = person.shape.reference_m, (lens.cx_px, lens.cy_px)
    return Pipeline(
        detector=detector,
        rules=RULES[mode](),
        range_finder=RANGES[mode](focal_px=lens.fx_px, reference_m=reference_m, centre_px=centre_px),
        place=ButtonPlace.in_the_middle(lens.width_px, lens.height_px, threshold_m),
        mode=ButtonMode(mode),
        depth_finder=DepthRange(mode=mode),
        **chosen,
    )
