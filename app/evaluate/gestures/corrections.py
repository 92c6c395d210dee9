"""Labels of photos that the photos themselves contradict, found among those that every fit classifies otherwise.

Of one Massey sitting the fours and fives are exchanged: the images show so at a glance. Fits take what is shown;
figures are told as labelled, and once more with these labels corrected.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import PurePath

from app.evaluate.readings import LabelledImage

_SITTING = range(31, 36)
# (file's stem, label given) to what is shown; a list that has been corrected already is left as it is
CORRECTED: dict[tuple[str, str], str] = {
    (f"massey_{given}_{number:04}", given): shown for number in _SITTING for given, shown in (("4", "5"), ("5", "4"))
}


def shown_label(image: LabelledImage) -> str:
    """The label of what the image shows."""
    return CORRECTED.get((PurePath(image.path).stem, image.label), image.label)


def corrected(image: LabelledImage) -> LabelledImage:
    """The image with the label of what it shows."""
    return replace(image, label=shown_label(image))
