"""Every code of hal has its text in every language, with the same values."""

from __future__ import annotations

from enum import Enum
from string import Formatter

import pytest

from hal import errors
from hal.cameras.camera import IntrinsicsSource
from hal.cameras.exposure import ImageFault
from hal.joints.can.candump import FrameKind
from hal.joints.can.scan import ScanReply
from hal.joints.codecs.wire import Order, WireQuantity
from hal.joints.guard import Quantity
from hal.joints.protocol import BusFault, DriveFault, DriveState, Joint
from logs.reason import key_of
from tests.support.catalogues import entries

FAULTS = (errors.CameraFault, errors.RecordingFault, errors.DeviceFault, errors.DrivesFault, errors.CanFault)
NAMES = (BusFault, DriveFault, DriveState, FrameKind, ImageFault, IntrinsicsSource, Joint, Order, Quantity, ScanReply)
ENGLISH, CHINESE = entries("en"), entries("zh")


def fields(text: str) -> set[str]:
    return {name for _, name, _, _ in Formatter().parse(text) if name}


@pytest.mark.parametrize("kind", [*FAULTS, *NAMES, WireQuantity], ids=lambda kind: kind.__name__)
def test_every_code_has_its_text_in_both_languages(kind: type[Enum]) -> None:
    for key in map(key_of, kind):
        assert fields(ENGLISH[key][0]) == fields(CHINESE[key][0]), key
