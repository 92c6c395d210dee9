"""The MuJoCo model of a wearer in the device: a planar trunk on two legs, floor, and blocks that a scene can place.

Axes: x forward, z up. Hip and knee flexion and ankle dorsiflexion are positive; the trunk's pitch is, forward.
"""

from __future__ import annotations

from math import radians

from hal.joints.body import (
    BUTTOCK_M,
    COM_OF_SHANK,
    COM_OF_THIGH,
    DEVICE_ON_SHANK,
    DEVICE_ON_THIGH,
    GYRATION_OF_SHANK,
    GYRATION_OF_THIGH,
    TRUNK_COM_OF_STATURE,
    TRUNK_GYRATION_OF_STATURE,
    Body,
)
from hal.joints.device import Exoskeleton, JointDevice
from hal.joints.scene import BlockKind

TIMESTEP_S = 0.002
SOLE_RADIUS_M = 0.015
LIMB_RADIUS_M = 0.05
ANKLE_DAMPING_NM_S_RAD = 1.5

# Who touches whom: bits of contype (bodies) and conaffinity (surroundings).
GROUND, HURDLE, SEAT = 1, 2, 4
# Blocks kept ready of each kind, and what they are to the body.
BLOCKS = {BlockKind.STEP: (2, GROUND), BlockKind.OBSTACLE: (1, HURDLE), BlockKind.CHAIR: (1, SEAT)}

HIPS_APART_M = 0.2  # for the eye only: nothing leaves the plane


def model_xml(body: Body, device: Exoskeleton) -> str:
    """The model as MJCF text."""
    trunk_kg = body.trunk_kg + (1 - 2 * DEVICE_ON_THIGH - 2 * DEVICE_ON_SHANK) * device.mass_kg
    height, gyration = TRUNK_COM_OF_STATURE * body.stature_m, TRUNK_GYRATION_OF_STATURE * body.stature_m
    legs = _leg(body, device, "left", (device.left_hip, device.left_knee))
    legs += _leg(body, device, "right", (device.right_hip, device.right_knee))
    return f"""<mujoco model="wearer">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="{TIMESTEP_S}" integrator="implicitfast" cone="elliptic" impratio="5" iterations="30"/>
  <size memory="2M"/>
  <default><geom friction="0.9 0.005 0.0001" solref="0.01 1" solimp="0.95 0.99 0.002"/></default>
  <worldbody>
    <body name="floor" mocap="true">
      <geom name="floor" type="plane" size="0 0 1" contype="0" conaffinity="{GROUND}"/>
    </body>
    {_blocks()}
    <body name="trunk" pos="0 0 0">
      <joint name="x" type="slide" axis="1 0 0"/>
      <joint name="z" type="slide" axis="0 0 1"/>
      <joint name="pitch" type="hinge" axis="0 1 0"/>
      {_inertial(trunk_kg, height, gyration)}
      <geom name="pelvis" type="sphere" size="{BUTTOCK_M}" contype="{SEAT | GROUND}" conaffinity="0" mass="0"/>
      {legs}
    </body>
  </worldbody>
</mujoco>"""


def _leg(body: Body, device: Exoskeleton, side: str, drives: tuple[JointDevice, JointDevice]) -> str:
    hip, knee = drives
    y = HIPS_APART_M / 2 if side == "left" else -HIPS_APART_M / 2
    thigh_kg = body.thigh_kg + DEVICE_ON_THIGH * device.mass_kg
    shank_kg = body.shank_kg + DEVICE_ON_SHANK * device.mass_kg
    sole = -body.ankle_height_m + SOLE_RADIUS_M
    return f"""
      <body name="{side}_thigh" pos="0 {y} 0">
        <joint name="{side}_hip" type="hinge" axis="0 -1 0" {_drive(hip)}/>
        {_inertial(thigh_kg, -COM_OF_THIGH * body.thigh_m, GYRATION_OF_THIGH * body.thigh_m)}
        <body name="{side}_shank" pos="0 0 {-body.thigh_m}">
          <joint name="{side}_knee" type="hinge" axis="0 1 0" {_drive(knee)}/>
          {_inertial(shank_kg, -COM_OF_SHANK * body.shank_m, GYRATION_OF_SHANK * body.shank_m)}
          <geom name="{side}_shank" type="capsule" fromto="0 0 0 0 0 {-0.8 * body.shank_m}" size="{LIMB_RADIUS_M}"
            contype="{HURDLE | GROUND}" conaffinity="0" mass="0"/>
          <body name="{side}_foot" pos="0 0 {-body.shank_m}">
            <joint name="{side}_ankle" type="hinge" axis="0 -1 0" damping="{ANKLE_DAMPING_NM_S_RAD}"
              range="-0.9 0.9"/>
            {_inertial(body.foot_kg, -0.5 * body.ankle_height_m, 0.5 * (body.heel_m + body.toe_m))}
            <geom name="{side}_foot" type="capsule" size="{SOLE_RADIUS_M}" contype="{GROUND | HURDLE}"
              conaffinity="0" mass="0"
              fromto="{-body.heel_m + SOLE_RADIUS_M} 0 {sole} {body.toe_m - SOLE_RADIUS_M} 0 {sole}"/>
          </body>
        </body>
      </body>"""


def _drive(joint: JointDevice) -> str:
    return (
        f'armature="{joint.rotor_inertia_kgm2}" frictionloss="{joint.friction_nm}" '
        f'range="{radians(joint.min_deg)} {radians(joint.max_deg)}"'
    )


def _inertial(mass_kg: float, z_m: float, gyration_m: float) -> str:
    about_y = mass_kg * gyration_m**2
    return f'<inertial mass="{mass_kg}" pos="0 0 {z_m}" diaginertia="{about_y} {about_y} {about_y}"/>'


def _blocks() -> str:
    return "\n    ".join(
        f'<body name="{kind.value}{number}" mocap="true" pos="0 0 -50">'
        f'<geom name="{kind.value}{number}" type="box" size="1 1 1" contype="0" conaffinity="{touched}"/></body>'
        for kind, (count, touched) in BLOCKS.items()
        for number in range(count)
    )
