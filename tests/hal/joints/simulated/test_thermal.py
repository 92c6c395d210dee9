"""The thermal model: energy is kept, equilibrium is the data sheet's, windings lead housings."""

from __future__ import annotations

import numpy as np

from hal.joints.device import ROOM_C, load_exoskeleton
from hal.joints.simulated.driver import Temperatures, at_rest, thermal_model, warm

MODEL = thermal_model(load_exoskeleton())


def after(seconds: float, torque_nm: float) -> Temperatures:
    now = at_rest(ROOM_C)
    for _ in range(int(seconds / 0.05)):
        now = warm(MODEL, now, np.full(4, torque_nm**2), ROOM_C, 0.05)
    return now


def test_drives_at_rest_stay_at_room_temperature() -> None:
    assert np.allclose(after(60, 0.0).winding_c, ROOM_C)


def test_heat_put_in_is_heat_stored_as_long_as_none_has_left() -> None:
    now = warm(MODEL, at_rest(ROOM_C), np.full(4, 900.0), ROOM_C, 0.05)
    stored = MODEL.winding_j_k * (now.winding_c - ROOM_C) + MODEL.housing_j_k * (now.housing_c - ROOM_C)
    assert np.allclose(stored, MODEL.loss_w_nm2 * 900.0 * 0.05)


def test_the_end_temperature_is_loss_times_the_whole_resistance() -> None:
    device = load_exoskeleton()
    joint = device.left_hip
    rise = joint.torque_constant_loss_w_nm2 * 30.0**2 * joint.thermal_resistance_k_w
    assert np.allclose(after(5000, 30.0).winding_c, ROOM_C + rise, atol=0.2)


def test_the_winding_is_ahead_of_the_housing_while_it_warms() -> None:
    now = after(20, 60.0)
    assert (now.winding_c > now.housing_c).all()
    assert (now.housing_c > ROOM_C).all()
