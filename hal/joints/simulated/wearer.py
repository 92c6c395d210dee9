"""The simulated wearer: MuJoCo stepped a tick at a time, with harness, balance, passive ankles and the scene.

What the model does not derive, it states: the harness carries a constant share of the weight, arrests a fall and lifts
a wearer whose drives gave no torque for some seconds to where a session starts, the wearer's arms hold the trunk at the
lean that the commanded knees call for, and the ankles are orthoses with springs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, sin

import mujoco
import numpy as np
from numpy.typing import NDArray

from hal.joints.body import (
    ANKLE_DORSIFLEXION_NM_RAD,
    ANKLE_PLANTARFLEXION_NM_RAD,
    ANKLE_REST_RAD,
    Body,
    trunk_lean_of,
)
from hal.joints.device import Exoskeleton
from hal.joints.protocol import JointArray
from hal.joints.scene import Block, BlockKind, Scene, Surroundings, next_surroundings
from hal.joints.simulated.harness import Reel
from hal.joints.simulated.mjcf import BLOCKS, TIMESTEP_S, model_xml

BALANCE_NM_RAD = 8000.0  # arms on crutches or rails, against the trunk's pitch
BALANCE_NM_S_RAD = 600.0
HOLD_N_M = 3000.0  # arms on crutches or rails, against the trunk's place over the feet
HOLD_N_S_M = 500.0
HOLD_MOST_N = 200.0
SHIFT_S = 0.08  # time constant with which the arms' idea of the standing foot follows a change of contact
SLUMP_M = 0.01  # a wearer put on the floor without power sinks so far into the harness
BLOCK_WIDTH_M = 0.6
DEEP_M = 2.0  # blocks reach this far down, so that nothing passes under them
# Without power the wearer sinks into the harness and swings, 10 s at most; so slow for so long is rest.
SETTLED_RAD_S, SETTLED_S, SINKS_S = 0.05, 2.0, 15.0
_HIDDEN = Block(kind=BlockKind.STEP, from_x_m=-0.01, to_x_m=0.01, top_m=-50.0)
_JOINTS = ("left_hip", "left_knee", "right_hip", "right_knee")
_ANKLES = ("left_ankle", "right_ankle")


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundTruth:
    """Where everything really is; (2,) arrays are left and right."""

    time_s: float
    hip_x_m: float
    hip_z_m: float
    lean_rad: float
    joints_rad: JointArray
    ankle_rad: NDArray[np.float64]
    ankle_m: NDArray[np.float64]  # (2, 2): foot, x and z
    contact_n: NDArray[np.float64]  # vertical force of floor, steps or obstacle on each foot
    balance_nm: float  # of the wearer's arms, on the trunk's lean
    hold_n: float  # of the wearer's arms, forward
    deepest_m: float  # how far anything has sunk into anything, positive
    struck: bool  # something touches the obstacle


class ReferencePose:
    """What a command makes of the body, were it carried out: the trunk's lean, the ankles before the hip."""

    __slots__ = ("ankle_speed_m_s", "ankle_x_m", "lean_rad")

    def __init__(self, body: Body, joints_rad: JointArray, speeds_rad_s: JointArray) -> None:
        left_hip, left_knee, right_hip, right_knee = joints_rad.tolist()
        speeds = speeds_rad_s.tolist()
        self.lean_rad = lean = trunk_lean_of(left_knee, right_knee)
        left, left_speed = _ankle(body, left_hip - lean, left_knee, speeds[0], speeds[1])
        right, right_speed = _ankle(body, right_hip - lean, right_knee, speeds[2], speeds[3])
        self.ankle_x_m = (left, right)
        self.ankle_speed_m_s = (left_speed, right_speed)


def _ankle_spring(angle_rad: float) -> float:
    bent = angle_rad - ANKLE_REST_RAD
    return -(ANKLE_DORSIFLEXION_NM_RAD if bent > 0 else ANKLE_PLANTARFLEXION_NM_RAD) * bent


def _ankle(body: Body, thigh_rad: float, knee_rad: float, hip_speed: float, knee_speed: float) -> tuple[float, float]:
    """The ankle's place before the hip and its speed, metres and m/s."""
    shank_rad = thigh_rad - knee_rad
    place = body.thigh_m * sin(thigh_rad) + body.shank_m * sin(shank_rad)
    of_thigh = body.thigh_m * cos(thigh_rad) * hip_speed
    return place, of_thigh + body.shank_m * cos(shank_rad) * (hip_speed - knee_speed)


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
        self._torques_at, self._ankles_at = self._v.tolist(), self._ankle_v.tolist()
        self._feet = [model.geom(f"{side}_foot").id for side in ("left", "right")]
        self._ankle_bodies = [model.body(f"{side}_foot").id for side in ("left", "right")]
        self._floor = int(model.body("floor").mocapid[0])
        self._pelvis = model.geom("pelvis").id
        self._chairs, self._obstacles = (
            {model.geom(f"{kind.value}{number}").id for number in range(BLOCKS[kind][0])}
            for kind in (BlockKind.CHAIR, BlockKind.OBSTACLE)
        )
        self.weight_n = float(model.body_subtreemass[model.body("trunk").id]) * 9.81
        self._supported_n = body.body_weight_support * self.weight_n
        self._reel = Reel()
        self._pose = ReferencePose(body, np.zeros(4), np.zeros(4))
        self._on_left = 0.5  # how much of the standing is the left foot's
        self._forces = [0.0] * model.nv
        self._view_memory()
        self.balance_nm = self.hold_n = 0.0
        self.place(np.zeros(4))

    def place(self, joints_rad: JointArray) -> None:
        """Put the wearer at rest on the floor in this pose, the harness locked a little lower."""
        data = self._data
        mujoco.mj_resetData(self._model, data)
        data.qpos[self._q] = joints_rad
        self._pose = ReferencePose(self.body, joints_rad, np.zeros(4))
        lean = self._pose.lean_rad
        data.qpos[2] = lean
        shanks = joints_rad[0::2] - lean - joints_rad[1::2]
        data.qpos[self._ankle_q] = -shanks
        mujoco.mj_forward(self._model, data)
        ankles = np.array([data.xpos[number][2] for number in self._ankle_bodies])
        data.qpos[1] = self.body.ankle_height_m - ankles.min()
        self._reel.lock(float(data.qpos[1]) - SLUMP_M)
        self._surround(Surroundings())
        mujoco.mj_forward(self._model, data)

    def settle(self) -> None:
        """Let the wearer sink into the harness without power, until the legs are at rest."""
        still_s = sunk_s = 0.0
        while still_s < SETTLED_S and sunk_s < SINKS_S:
            self.advance([0.0] * 4, None)
            sunk_s += TIMESTEP_S
            still_s = still_s + TIMESTEP_S if max(map(abs, self.speeds_rad_s.tolist())) < SETTLED_RAD_S else 0.0

    def stage(self, scene: Scene) -> None:
        """Put the scene of the coming action around the feet; a wearer in the midst of something finds it as it is."""
        left, right = (float(self._data.xpos[number][0]) for number in self._ankle_bodies)
        self._surround(next_surroundings(self._around, scene, (left, right), float(self._data.qpos[0])))

    def _surround(self, around: Surroundings) -> None:
        self._around = around
        self._data.mocap_pos[self._floor] = (0.0, 0.0, around.floor_m)
        for kind, (count, _) in BLOCKS.items():
            blocks = [block for block in around.blocks if block.kind is kind]
            for number in range(count):
                block = blocks[number] if number < len(blocks) else _HIDDEN
                self._put(f"{kind.value}{number}", block)

    def _view_memory(self) -> None:
        """Views of the simulation's own memory: to ask for one anew costs a microsecond."""
        self._qpos, self._qvel, self._xpos = self._data.qpos, self._data.qvel, self._data.xpos

    def __setstate__(self, state: dict[str, object]) -> None:
        """A copy views its own memory, not copies of the original's views."""
        self.__dict__.update(state)
        self._view_memory()

    def advance(self, torque_nm: Sequence[float], pose: ReferencePose | None) -> None:
        """One step of physics; without a commanded posture the arms keep the lean there was and hold no place."""
        forces, qpos, qvel = self._forces, self._qpos.tolist(), self._qvel.tolist()
        if pose is not None:
            self._pose = pose
        for at, torque in zip(self._torques_at, torque_nm, strict=True):
            forces[at] = torque
        for at, angle in zip(self._ankles_at, self._qpos.take(self._ankle_q).tolist(), strict=True):
            forces[at] = _ankle_spring(angle)
        if self._reel.lifts(unpowered=not any(torque_nm)) and not self._sits():
            self._reel.wind(qpos[1], self._start_m())
        harness_n = self._supported_n + self._reel.force_n(qpos[1], qvel[1])
        self.balance_nm = BALANCE_NM_RAD * (self._pose.lean_rad - qpos[2]) - BALANCE_NM_S_RAD * qvel[2]
        self.hold_n = 0.0 if pose is None else self._hold(pose, qpos[0], qvel[0])
        forces[:3] = self.hold_n, harness_n, self.balance_nm
        self._data.qfrc_applied[:] = forces
        mujoco.mj_step(self._model, self._data)

    @property
    def joints_rad(self) -> JointArray:
        """(4,)."""
        angles: JointArray = self._qpos.take(self._q)
        return angles

    @property
    def speeds_rad_s(self) -> JointArray:
        """(4,)."""
        speeds: JointArray = self._qvel.take(self._v)
        return speeds

    def contact_n(self) -> tuple[float, float]:
        """Vertical force on the left and the right foot."""
        left_n, right_n = self._contacts()[0].tolist()
        return left_n, right_n

    def ground_truth(self) -> GroundTruth:
        """Everything that can be known now; too slow for every tick of a real-time loop."""
        data = self._data
        feet, deepest, struck = self._contacts()
        return GroundTruth(
            time_s=float(data.time),
            hip_x_m=float(data.qpos[0]),
            hip_z_m=float(data.qpos[1]),
            lean_rad=float(data.qpos[2]),
            joints_rad=self.joints_rad.copy(),
            ankle_rad=data.qpos[self._ankle_q].copy(),
            ankle_m=np.array([data.xpos[number][[0, 2]] for number in self._ankle_bodies]),
            contact_n=feet,
            balance_nm=self.balance_nm,
            hold_n=self.hold_n,
            deepest_m=deepest,
            struck=struck,
        )

    def _hold(self, pose: ReferencePose, at: float, moving: float) -> float:
        """The arms' horizontal force towards where the commanded posture has the hip over the standing feet."""
        touching = self._data.contact.geom.ravel().tolist()
        left, right = self._feet[0] in touching, self._feet[1] in touching
        if left or right:
            wanted = 0.5 if left and right else float(left)
            self._on_left += (wanted - self._on_left) * (TIMESTEP_S / SHIFT_S)
        on_left, on_right = self._on_left, 1 - self._on_left
        feet = self._xpos[self._ankle_bodies, 0].tolist()
        place = on_left * (feet[0] - pose.ankle_x_m[0]) + on_right * (feet[1] - pose.ankle_x_m[1])
        speed = -on_left * pose.ankle_speed_m_s[0] - on_right * pose.ankle_speed_m_s[1]
        force = HOLD_N_M * (place - at) + HOLD_N_S_M * (speed - moving)
        held: float = min(max(force, -HOLD_MOST_N), HOLD_MOST_N)
        return held

    def _start_m(self) -> float:
        """The harness's height at a session's start, over the lower foot."""
        body = self.body
        return min(map(self._sole_m, self._feet)) + body.ankle_height_m + body.thigh_m + body.shank_m - SLUMP_M

    def _sole_m(self, foot: int) -> float:
        """Height of a foot's lowest place."""
        radius, half = self._model.geom_size[foot][:2]
        return float(self._data.geom_xpos[foot][2] - half * abs(self._data.geom_xmat[foot][8]) - radius)

    def _sits(self) -> bool:
        pairs = self._data.contact.geom.tolist()
        return any(self._pelvis in pair and self._chairs.intersection(pair) for pair in pairs)

    def _put(self, name: str, block: Block) -> None:
        geom = self._model.geom(name).id
        middle, half = (block.from_x_m + block.to_x_m) / 2, (block.to_x_m - block.from_x_m) / 2
        self._model.geom_size[geom] = (half, BLOCK_WIDTH_M, DEEP_M / 2)
        self._model.geom_rbound[geom] = float(np.linalg.norm(self._model.geom_size[geom]))
        self._model.geom_aabb[geom, 3:] = self._model.geom_size[geom]
        mocap = self._model.body(name).mocapid[0]
        self._data.mocap_pos[mocap] = (middle, 0.0, block.top_m - DEEP_M / 2)

    def _contacts(self) -> tuple[NDArray[np.float64], float, bool]:
        data = self._data
        feet, deepest, struck = np.zeros(2), 0.0, False
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
            struck = struck or bool(self._obstacles.intersection(pair))
        return feet, deepest, struck
