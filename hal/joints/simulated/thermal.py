"""Two-node thermal model of four drives: winding and housing. Pure: temperatures in, temperatures out.

The device description gives resistance and capacity of the whole drive; how they divide is typical of small servo
motors, whose winding follows the load in seconds and whose housing in minutes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hal.joints.device import Exoskeleton
from hal.joints.protocol import JointArray

WINDING_CAPACITY_SHARE = 0.12
WINDING_RESISTANCE_SHARE = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalModel:
    """Each (4,): heat capacities J/K, resistances K/W winding to housing and housing to room, loss W/Nm²."""

    winding_j_k: JointArray
    housing_j_k: JointArray
    winding_k_w: JointArray
    housing_k_w: JointArray
    loss_w_nm2: JointArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Temperatures:
    """Each (4,), °C."""

    winding_c: JointArray
    housing_c: JointArray


def thermal_model(device: Exoskeleton) -> ThermalModel:
    """The device's drives, each divided into winding and housing."""
    capacity = np.array([joint.thermal_capacity_j_k for joint in device.joints])
    resistance = np.array([joint.thermal_resistance_k_w for joint in device.joints])
    return ThermalModel(
        winding_j_k=WINDING_CAPACITY_SHARE * capacity,
        housing_j_k=(1 - WINDING_CAPACITY_SHARE) * capacity,
        winding_k_w=WINDING_RESISTANCE_SHARE * resistance,
        housing_k_w=(1 - WINDING_RESISTANCE_SHARE) * resistance,
        loss_w_nm2=np.array([joint.torque_constant_loss_w_nm2 for joint in device.joints]),
    )


def at_rest(room_c: float) -> Temperatures:
    """Drives that have long been off."""
    return Temperatures(winding_c=np.full(4, room_c), housing_c=np.full(4, room_c))


def warm(model: ThermalModel, now: Temperatures, square_nm2: JointArray, room_c: float, time_s: float) -> Temperatures:
    """Temperatures after a time short against seconds; square_nm2: (4,) mean square of the joint torque in it."""
    across = (now.winding_c - now.housing_c) / model.winding_k_w
    winding = now.winding_c + (model.loss_w_nm2 * square_nm2 - across) * (time_s / model.winding_j_k)
    away = (now.housing_c - room_c) / model.housing_k_w
    housing = now.housing_c + (across - away) * (time_s / model.housing_j_k)
    return Temperatures(winding_c=winding, housing_c=housing)
