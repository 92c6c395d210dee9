"""Records of the trail in Chinese: no value of an enumeration stays in English."""

from __future__ import annotations

import pytest

from app.ipc.states import Action, GaitState
from app.text.catalogue import be_strict, render, use_language
from app.text.recorded import render_recorded
from hal.cameras.camera import IntrinsicsSource
from hal.inputs.device import Contact, InputRole
from hal.joints.protocol import DriveState
from logs.reason import Reason, Value
from profiles.palm import ReferenceSource

STOPPED = {"name": "P1", "role": InputRole.EMERGENCY_STOP.value, "contact": Contact.OPEN.value, "reason": ""}
CAMERA = {"camera": "C1", "width_px": 640, "height_px": 480, "focal_px": 600.0, "rate_hz": 30.0, "measured_hz": 29.0}


@pytest.mark.parametrize(
    ("record", "values", "text"),
    [
        ("StopInput", STOPPED, "停止按钮 P1（急停）断开"),
        ("StopInput", STOPPED | {"role": "wearer", "contact": "closed"}, "停止按钮 P1（穿戴者）闭合"),
        ("StopInput", STOPPED | {"role": "therapist", "contact": "silent"}, "停止按钮 P1（治疗师）无应答"),
        ("SignIn", {"name": "Ada", "role": "engineer"}, "Ada 以 工程师 身份登录"),
        ("Drives", {"state": DriveState.DISABLED.value, "detail": ""}, "驱动器 已断开使能"),
        ("Camera", CAMERA | {"intrinsics_source": IntrinsicsSource.ASSUMED.value}, "，假定，"),
        (
            "Calibration",
            {"method": ReferenceSource.ESTIMATED.value, "anchor_m": 0.0615, "text": ""},
            "掌部参考段 6.2 cm，估计",
        ),
        (
            "GaitChanged",
            {"change": "", "state": GaitState.STANDING.value, "running": Action.WALK.value},
            "站立，进行中 连续行走",
        ),
    ],
)
def test_a_recorded_value_is_named_in_chinese(record: str, values: dict[str, str | int | float], text: str) -> None:
    use_language("zh")
    assert text in render_recorded(Reason(f"Record.{record}", dict(values)))


def test_a_value_that_no_enumeration_has_is_shown_as_it_was_recorded() -> None:
    use_language("zh")
    assert "other-way" in render_recorded(Reason("Record.Drives", {"state": "other-way", "detail": ""}))


def test_values_that_a_wording_of_another_version_lacks_are_shown_with_their_code() -> None:
    refused = Reason("RequestRefusal.WRONG_STATE", {"action": "walk"})
    with pytest.raises(KeyError):
        render(refused)
    be_strict(False)
    text = render(refused)
    be_strict()
    assert "WRONG_STATE" in text
    assert "walk" in text


def test_an_event_of_an_older_trail_has_no_detail() -> None:
    beyond: dict[str, Value] = {"joint": Reason("Joint.LEFT_KNEE"), "angle_rad": 1.5, "limit_rad": 1.4}
    detail = Reason("AngleDetail.BEYOND_PATIENT", beyond)
    older = render_recorded(Reason("Event.NOT_HOMED", {}))
    newer = render_recorded(Reason("Event.NOT_HOMED", {"detail": detail}))
    assert older.startswith("A joint reads an angle out of its range.")
    assert newer.startswith("A joint reads an angle out of its range (")
