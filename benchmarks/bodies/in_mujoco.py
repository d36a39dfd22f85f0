"""The same bodies in MuJoCo, with position servos of the same torque; their speed is limited by damping only."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from benchmarks.eyes.mujoco_eyes import import_mujoco
from testbed.bodies.morphology import CappedCylinder, Cuboid, Morphology, Part, Vector


class MuJoCoBody:
    """A body on the ground.

    Args:
        body: Which.
        step: Seconds of a physics step.
    """

    def __init__(self, body: Morphology, step: float) -> None:
        self.mujoco = import_mujoco()
        self.model = self.mujoco.MjModel.from_xml_string(_world(body, step))
        self.data = self.mujoco.MjData(self.model)

    def settle(self, commands: Vector, *, looks: int, rest_speed: float) -> Vector:
        """(n, 4) orientation wxyz after each of the (n, joints) commands."""
        found = []
        for command in commands:
            self.mujoco.mj_resetData(self.model, self.data)
            self.data.ctrl[:] = command
            for _ in range(looks):
                self.mujoco.mj_step(self.model, self.data, 12)
                if np.abs(self.data.qvel[3:]).max() < rest_speed:
                    break
            found.append(self.data.qpos[3:7].copy())
        return np.array(found)

    def move(self, targets: Vector, substeps: int) -> Vector:
        """(steps, 7) position and orientation wxyz of the root after each of the (steps, joints) targets."""
        self.mujoco.mj_resetData(self.model, self.data)
        bases = np.empty((len(targets), 7))
        for step, target in enumerate(targets):
            self.data.ctrl[:] = target
            self.mujoco.mj_step(self.model, self.data, substeps)
            bases[step] = self.data.qpos[:7]
        return bases


def _world(body: Morphology, step: float) -> str:
    motors = "".join(
        f"<position joint='{name}' kp='8' kv='.4' forcerange='{-joint.torque} {joint.torque}'/>"
        for name, joint in body.joints.items()
    )
    return f"""<mujoco><option timestep='{step}' integrator='implicitfast'/><worldbody>
        <geom type='plane' size='0 0 1' contype='1' conaffinity='0' friction='.01'/>
        <body pos='0 0 {body.resting_height()}'><freejoint/>{_geom(body.parts[body.root], 0.0)}
        {_limbs(body, body.root)}</body></worldbody><actuator>{motors}</actuator></mujoco>"""


def _limbs(body: Morphology, parent: str) -> str:
    text = ""
    for name, joint in body.joints.items():
        if joint.parent != parent:
            continue
        mount, child = body.mount(joint), body.parts[joint.child]
        x, y, z = mount[:3, 3]
        x += 0.0 if parent == body.root else body.parts[parent].from_hinge  # a body's frame is in its hinge
        yaw = math.atan2(mount[1, 0], mount[0, 0])
        text += f"""<body pos='{x} {y} {z}' quat='{math.cos(yaw / 2)} 0 0 {math.sin(yaw / 2)}'>
            <joint name='{name}' axis='0 1 0'/>{_geom(child, child.from_hinge)}{_limbs(body, joint.child)}</body>"""
    return text


def _geom(part: Part, offset: float) -> str:
    common = f"mass='{part.mass}' friction='{part.friction}' contype='0' conaffinity='1'"
    if isinstance(part, Cuboid):
        sides = " ".join(str(side / 2) for side in part.size)
        return f"<geom type='box' size='{sides}' pos='{offset} 0 0' {common}/>"
    assert isinstance(part, CappedCylinder)
    reach = part.length / 2
    ends = f"{offset - reach} 0 0 {offset + reach} 0 0"
    return f"<geom type='capsule' size='{part.radius}' fromto='{ends}' {common}/>"


def up_of(turns: Any) -> Vector:
    """(n, 3) the world's up in the root's frame, of orientations (n, 4) wxyz."""
    w, x, y, z = np.asarray(turns).T
    return np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1)
