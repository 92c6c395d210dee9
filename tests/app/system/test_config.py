"""Configuration: defaults without a file, and a sentence that names the field when one is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.system.config import CameraConfig, Config, load_config, with_choices
from app.system.errors import AppError
from hal.inputs.device import InputDevice, InputRole


def test_no_file_means_defaults(tmp_path: Path) -> None:
    assert load_config(tmp_path / "config.toml") == Config()


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("theme = 'pink'\n", "theme"),
        ("[camera]\nkind = 'periscope'\n", "camera.kind"),
        ("[camera]\nwidth_px = 3\n", "camera.width_px"),
        ("[camera]\nfocal_px = -1.0\n", "camera.focal_px"),
        ("[button]\nx = 2.0\n", "button.x"),
        ("rules = 'loose'\n", "rules"),
        ("unknown = 1\n", "unknown"),
        ("not toml at all", "config.toml"),
        ("idle_lock_s = 'soon'\n", "idle_lock_s"),
        ("[[inputs]]\nname = 'A b'\nrole = 'wearer'\nkind = 'simulated'\n", r"inputs\[0\].name"),
        ("[[inputs]]\nname = 'a'\nrole = 'nurse'\nkind = 'simulated'\n", r"inputs\[0\].role"),
        ("[[inputs]]\nname = 'a'\nrole = 'wearer'\nkind = 'can'\n", "needs its can_id"),
        (2 * "[[inputs]]\nname = 'a'\nrole = 'wearer'\nkind = 'simulated'\n", "two inputs are named a"),
        ("joints.kind = 'can'\n[[inputs]]\nname = 'a'\nrole = 'wearer'\nkind = 'simulated'\n", "beside real drives"),
    ],
)
def test_a_wrong_field_is_named(tmp_path: Path, text: str, named: str) -> None:
    path = tmp_path / "config.toml"
    path.write_text(text)
    with pytest.raises(AppError, match=named):
        load_config(path)


PENDANT_ON_CAN = """
[[inputs]]
name = "pendant"
role = "wearer"
kind = "can"
can_id = 0x181
bus.channel = "{channel}"
"""


@pytest.mark.parametrize(
    ("joints", "channel", "shared"),
    [
        ("kind = 'can'", "can0", True),
        ("kind = 'can'", "can1", False),
        ("kind = 'can'\nchannel = 'can1'", "can1", True),
        ("kind = 'can'\nchannel = 'can1'", "can0", False),
        ("kind = 'can'\ninterface = 'local'", "can0", False),
        ("kind = 'simulated'", "can0", False),
    ],
)
def test_a_stop_button_shares_no_bus_with_the_drives(tmp_path: Path, joints: str, channel: str, shared: bool) -> None:
    path = tmp_path / "config.toml"
    path.write_text(f"[joints]\n{joints}\n" + PENDANT_ON_CAN.format(channel=channel))
    if shared:
        with pytest.raises(AppError, match=f"pendant is on {channel} with the drives"):
            load_config(path)
    else:
        assert load_config(path).inputs[0].bus.channel == channel


def test_command_line_choices_replace_only_what_they_name() -> None:
    chosen = with_choices(Config(), camera="webcam", joints=None, patient="p-1")
    assert (chosen.camera.kind, chosen.joints.kind, chosen.patient) == ("webcam", "simulated", "p-1")


def test_another_camera_has_not_the_lens_of_the_configured_one() -> None:
    film = CameraConfig(kind="recording", device="f.mp4", focal_px=600.0, mirrored=True, rate_hz=15.0)
    other = with_choices(Config(camera=film), camera="webcam", joints=None, patient=None).camera
    assert other == CameraConfig(kind="webcam", rate_hz=15.0)
    assert with_choices(Config(camera=film), camera="recording", joints=None, patient=None).camera == film


def test_joints_that_the_inputs_do_not_suit_are_refused() -> None:
    pendant = InputDevice(name="pendant", role=InputRole.WEARER, kind="simulated")
    with pytest.raises(AppError, match=r"UNSUITABLE .*pendant is simulated"):
        with_choices(Config(inputs=(pendant,)), camera=None, joints="can", patient=None)
    on_can = InputDevice(name="pendant", role=InputRole.WEARER, kind="can", can_id=0x181)
    with pytest.raises(AppError, match=r"UNSUITABLE .*bus of its own"):
        with_choices(Config(inputs=(on_can,)), camera=None, joints="can", patient=None)
