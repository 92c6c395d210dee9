"""The motor table: what it refuses, how users extend it."""

from __future__ import annotations

from pathlib import Path

import pytest

from hal.errors import DeviceFault, HardwareError
from hal.joints.motors import load_motors
from hal.joints.protocol import DriveFault
from tests.support.errors import refused

ENTRY = """
[[motor]]
name = "{name}"
version = "{version}"
protocol = "mit"
source = "my own bench, 2026"
velocity_rad_s = {velocity}
torque_nm = 9.0
{more}
"""


def write(folder: Path, **fields: object) -> Path:
    path = folder / "motors.toml"
    values: dict[str, object] = {"name": "mine", "version": "1", "velocity": 10.0, "more": "", **fields}
    path.write_text(ENTRY.format(**values))
    return path


def test_a_name_with_one_version_needs_none() -> None:
    assert load_motors().find("DM8009").label == "DM8009/default"


def test_a_name_with_several_versions_is_never_guessed() -> None:
    with pytest.raises(HardwareError, match=r"AK80-9/V1\.1, AK80-9/V2, AK80-9/V2-25"):
        load_motors().find("AK80-9")


def test_an_unknown_motor_lists_the_known() -> None:
    with pytest.raises(HardwareError, match="CyberGear/manual"):
        load_motors().find("AK99")


def test_every_entry_names_its_source_and_only_known_faults() -> None:
    for entry in load_motors().entries.values():
        assert len(entry.source) > 20, entry.label
        assert all(DriveFault[name] for name in entry.errors.values())


def test_openexo_scales_torque_by_its_current_range_and_torque_constant() -> None:
    """Motor.cpp, AK70: _I_MAX = 23.2 A, kt = 0.13 · 10 Nm/A at the output."""
    motor = load_motors().find("AK70-10/OpenExo")
    assert motor.velocity_rad_s == 15.5
    assert motor.torque_nm == pytest.approx(23.2 * 0.13 * 10)


def test_users_add_entries(tmp_path: Path) -> None:
    table = load_motors(write(tmp_path))
    assert table.find("mine").velocity_rad_s == 10.0
    assert table.find("DM8009").torque_nm == 54.0


def test_users_replace_an_entry_by_its_label(tmp_path: Path) -> None:
    path = write(tmp_path, name="AK80-64", version="V2", velocity=9.5)
    assert load_motors(path).find("AK80-64/V2").velocity_rad_s == 9.5


@pytest.mark.parametrize(
    ("fields", "reported"),
    [
        ({"velocity": -1}, "velocity_rad_s"),
        ({"velocity": '"fast"'}, "velocity_rad_s"),
        ({"more": "sped = 3"}, "sped"),
        ({"more": 'errors = { 1 = "ON_FIRE" }'}, "ON_FIRE"),
        ({"more": 'reply = "nine bytes"'}, "nine bytes"),
        ({"more": "= ="}, "motors.toml"),
    ],
)
def test_a_broken_table_is_refused_with_file_and_field(
    tmp_path: Path, fields: dict[str, object], reported: str
) -> None:
    path = write(tmp_path, **fields)
    with pytest.raises(HardwareError) as caught:
        load_motors(path)
    assert reported in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_missing_table_is_refused_by_name(tmp_path: Path) -> None:
    with refused(DeviceFault.MOTORS_UNREADABLE, path=tmp_path / "nowhere.toml"):
        load_motors(tmp_path / "nowhere.toml")


def test_error_codes_are_the_can_tables_not_the_serial_ports() -> None:
    motor = load_motors().find("AK80-64/V2")
    reported = [motor.fault_of(code) for code in range(8)]
    assert reported == [
        DriveFault.NONE,
        DriveFault.OVER_TEMPERATURE,
        DriveFault.OVER_CURRENT,
        DriveFault.OVER_VOLTAGE,
        DriveFault.UNDER_VOLTAGE,
        DriveFault.ENCODER,
        DriveFault.PHASE,
        DriveFault.OTHER,
    ]
