"""The simulated wearer: MuJoCo stepped a tick at a time, with harness, balance, passive ankles and the scene.

What the model does not derive, it states: the harness carries a constant share of the weight and arrests a fall, the
wearer's arms hold the trunk at the lean that the commanded knees call for, and the ankles are orthoses with springs.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from hal.joints.body import (
    ANKLE_DORSIFLEXION_NM_RAD,
    ANKLE_PLANTARFLEXION_NM_RAD,
    ANKLE_REST_RAD,
    Body,
    trunk_lean,
)
from hal.joints.device import Exoskeleton
from hal.joints.joints import JointArray
from hal.joints.mjcf import CHAIRS, OBSTACLES, STEPS, TIMESTEP_S, model_xml
from hal.joints.scene import LEVEL_FLOOR, BlockKind, Scene

BALANCE_NM_RAD = 8000.0  # arms on crutches or rails, against the trunk's pitch
BALANCE_NM_S_RAD = 600.0
REEL_SPEED_M_S = 0.6  # a harness that pays out faster than this locks, as a fall-arrest reel does
REEL_N_M = 30_000.0
REEL_N_S_M = 4000.0
SLUMP_M = 0.01  # a wearer put on the floor without power sinks so far into the harness
REEL_SLACK_S = 0.3  # without load for this long it runs free again
BLOCK_WIDTH_M = 0.6
DEEP_M = 2.0  # blocks reach this far down, so that nothing passes under them
HIDDEN_M = -50.0
_JOINTS = ("left_hip", "left_knee", "right_hip", "right_knee")
_ANKLES = ("left_ankle", "right_ankle")
_KINDS = {BlockKind.STEP: ("step", STEPS), BlockKind.OBSTACLE: ("obstacle", OBSTACLES), BlockKind.CHAIR: ("chair", CHAIRS)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """Where everything really is; (2,) arrays are left and right."""

    time_s: float
    hip_x_m: float
    hip_z_m: float
    lean_rad: float
    joints_rad: JointArray
    ankle_rad: NDArray[np.float64]
    ankle_m: NDArray[np.float64]  # (2, 2): foot, x and z
    contact_n: NDArray[np.float64]  # vertical force of floor, steps or obstacle on each foot
    seat_n: float
    harness_n: float
    balance_nm: float
    deepest_m: float  # how far anything has sunk into anything, positive
    struck: bool  # something touches the obstacle


class Wearer:
    """One body in one device; `advance` moves it by one step of physics under joint torques."""

    def __init__(self, device: Exoskeleton, body: Body) -> None:
        self.body = body
        self._model = mujoco.MjModel.from_xml_string(model_xml(body, device))
        self._data = mujoco.MjData(self._model)
        model = self._model
        self._q = np.array([model.joint(name).qposadr[0] for name in _JOINTS])
        self._v = np.array([model.joint(name).dofadr[0] for name in _JOINTS])
        self._ankle_q = np.array([model.joint(name).qposadr[0] for name in _ANKLES])
        self._ankle_v = np.array([model.joint(name).dofadr[0] for name in _ANKLES])
        self._feet = [model.geom(f"{side}_foot").id for side in ("left", "right")]
        self._ankle_bodies = [model.body(f"{side}_foot").id for side in ("left", "right")]
        self._floor = model.geom("floor").id
        self._pelvis = model.geom("pelvis").id
        self._obstacles = {model.geom(f"obstacle{number}").id for number in range(OBSTACLES)}
        self.weight_n = float(model.body_subtreemass[model.body("trunk").id]) * 9.81
        self._carried_n = body.body_weight_support * self.weight_n
        self._reel_m: float | None = None
        self._slack_s = 0.0
        self._lean_rad = 0.0
        self._forces = np.zeros(model.nv)
        self.harness_n = self.balance_nm = 0.0
        self.place(np.zeros(4))

    def place(self, joints_rad: JointArray) -> None:
        """Put the wearer at rest on the floor in this pose, the harness locked a little lower."""
        data = self._data
        mujoco.mj_resetData(self._model, data)
        data.qpos[self._q] = joints_rad
        self._lean_rad = float(trunk_lean(joints_rad[1], joints_rad[3]))
        data.qpos[2] = self._lean_rad
        shanks = joints_rad[0::2] - self._lean_rad - joints_rad[1::2]
        data.qpos[self._ankle_q] = -shanks
        mujoco.mj_forward(self._model, data)
        ankles = np.array([data.xpos[number][2] for number in self._ankle_bodies])
        data.qpos[1] = self.body.ankle_height_m - ankles.min()
        self._reel_m, self._slack_s = float(data.qpos[1]) - SLUMP_M, 0.0
        self.stage(LEVEL_FLOOR)
        mujoco.mj_forward(self._model, data)

    def stage(self, scene: Scene) -> None:
        """Put these blocks around the feet, and the floor under them, as the coming action needs."""
        data = self._data
        ankles = np.array([data.xpos[number] for number in self._ankle_bodies])
        here = float(ankles[:, 0].mean())
        ground = float(ankles[:, 2].min()) - self.body.ankle_height_m if data.ncon == 0 else self._standing_on()
        self._model.geom_pos[self._floor][2] = ground + scene.floor_m
        for kind, (name, count) in _KINDS.items():
            blocks = [block for block in scene.blocks if block.kind is kind]
            for number in range(count):
                block = blocks[number] if number < len(blocks) else None
                span = (0.0, 0.0, HIDDEN_M) if block is None else (block.from_x_m, block.to_x_m, block.top_m)
                self._put(f"{name}{number}", here, ground, span)

    def advance(self, torque_nm: JointArray, commanded_knees_rad: tuple[float, float] | None) -> None:
        """One step of physics; without commanded knees the wearer keeps the lean there was."""
        data, forces = self._data, self._forces
        if commanded_knees_rad is not None:
            self._lean_rad = float(trunk_lean(np.array(commanded_knees_rad[0]), np.array(commanded_knees_rad[1])))
        forces[self._v] = torque_nm
        bent = data.qpos[self._ankle_q] - ANKLE_REST_RAD
        forces[self._ankle_v] = -np.where(bent > 0, ANKLE_DORSIFLEXION_NM_RAD, ANKLE_PLANTARFLEXION_NM_RAD) * bent
        self.harness_n = self._carried_n + self._reel()
        self.balance_nm = float(BALANCE_NM_RAD * (self._lean_rad - data.qpos[2]) - BALANCE_NM_S_RAD * data.qvel[2])
        forces[1], forces[2] = self.harness_n, self.balance_nm
        data.qfrc_applied[:] = forces
        mujoco.mj_step(self._model, data)

    @property
    def joints_rad(self) -> JointArray:
        """(4,)."""
        angles: JointArray = self._data.qpos[self._q]
        return angles

    @property
    def speeds_rad_s(self) -> JointArray:
        """(4,)."""
        speeds: JointArray = self._data.qvel[self._v]
        return speeds

    def truth(self) -> Truth:
        """Everything that can be known now; too slow for every tick of a real-time loop."""
        data = self._data
        feet, seat, deepest, struck = self._contacts()
        return Truth(
            time_s=float(data.time),
            hip_x_m=float(data.qpos[0]),
            hip_z_m=float(data.qpos[1]),
            lean_rad=float(data.qpos[2]),
            joints_rad=self.joints_rad.copy(),
            ankle_rad=data.qpos[self._ankle_q].copy(),
            ankle_m=np.array([data.xpos[number][[0, 2]] for number in self._ankle_bodies]),
            contact_n=feet,
            seat_n=seat,
            harness_n=self.harness_n,
            balance_nm=self.balance_nm,
            deepest_m=deepest,
            struck=struck,
        )

    def _reel(self) -> float:
        """The force of a harness that locks when it pays out too fast, newtons."""
        height, speed = float(self._data.qpos[1]), float(self._data.qvel[1])
        if self._reel_m is None:
            if speed > -REEL_SPEED_M_S:
                return 0.0
            self._reel_m, self._slack_s = height, 0.0
        force = max(0.0, REEL_N_M * (self._reel_m - height) - REEL_N_S_M * speed)
        force = force if height < self._reel_m else 0.0
        self._slack_s = self._slack_s + TIMESTEP_S if force <= 0 else 0.0
        if self._slack_s > REEL_SLACK_S:
            self._reel_m = None
        return force

    def _put(self, name: str, here_m: float, ground_m: float, span: tuple[float, float, float]) -> None:
        from_x, to_x, top = span
        geom = self._model.geom(name).id
        self._model.geom_size[geom] = ((to_x - from_x) / 2 or 0.01, BLOCK_WIDTH_M, DEEP_M / 2)
        self._model.geom_rbound[geom] = float(np.linalg.norm(self._model.geom_size[geom]))
        self._model.geom_aabb[geom, 3:] = self._model.geom_size[geom]
        mocap = self._model.body(name).mocapid[0]
        self._data.mocap_pos[mocap] = (here_m + (from_x + to_x) / 2, 0.0, ground_m + top - DEEP_M / 2)

    def _standing_on(self) -> float:
        """The height of what the feet stand on."""
        heights = [
            contact.pos[2] for contact in self._data.contact if contact.geom1 in self._feet or contact.geom2 in self._feet
        ]
        lowest = min(self._data.xpos[number][2] for number in self._ankle_bodies) - self.body.ankle_height_m
        return float(max(heights)) if heights else float(lowest)

    def _contacts(self) -> tuple[NDArray[np.float64], float, float, bool]:
        data = self._data
        feet, seat, deepest, struck = np.zeros(2), 0.0, 0.0, False
        force = np.zeros(6)
        for number in range(data.ncon):
            contact = data.contact[number]
            pair = (int(contact.geom1), int(contact.geom2))
            deepest = max(deepest, -float(contact.dist))
            mujoco.mj_contactForce(self._model, data, number, force)
            # the contact's frame has its normal first; its vertical part carries
            frame = np.asarray(contact.frame).reshape(3, 3)
            up = abs(float(frame[:, 2] @ force[:3]))
            for side, foot in enumerate(self._feet):
                if foot in pair:
                    feet[side] += up
            seat += up if self._pelvis in pair else 0.0
            struck = struck or bool(self._obstacles.intersection(pair))
        return feet, seat, deepest, struck
