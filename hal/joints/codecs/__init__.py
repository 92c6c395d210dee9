"""Bytes on the wire and what they mean: one file a protocol, pure, the same function names in each.

Every codec can speak both ends: the driver's (`command`, `order`, `read_reply`) and the drive's (`read_command`,
`reply`), so that the emulator and the tests share the exact scaling and nothing is written down twice.
"""

from __future__ import annotations

from hal.joints.codecs.cubemars import AkV3Codec, ServoCodec
from hal.joints.codecs.cybergear import CyberGearCodec
from hal.joints.codecs.damiao import DamiaoCodec
from hal.joints.codecs.mit import MitCodec
from hal.joints.codecs.wire import Codec
from hal.joints.motors import MotorModel, WireProtocol

CODECS: dict[WireProtocol, type[Codec]] = {
    WireProtocol.MIT: MitCodec,
    WireProtocol.AK_V3: AkV3Codec,
    WireProtocol.DAMIAO: DamiaoCodec,
    WireProtocol.CYBERGEAR: CyberGearCodec,
    WireProtocol.SERVO: ServoCodec,
}


def codec_of(motor: MotorModel) -> Codec:
    """The codec of this motor's protocol with this motor's ranges."""
    return CODECS[motor.protocol](motor)
