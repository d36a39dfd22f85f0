"""The least that somebody with PyBullet alone would write: no names, no objects, and the URDF file already there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from testbed.bodies.morphology import Morphology, Vector
from testbed.bodies.urdf import write_urdf
from testbed.silence import silence

with silence():
    import pybullet


@dataclass(frozen=True)
class OnDisk:
    """A body as such a user has it: a file, and a few numbers.

    Attributes:
        file: Its URDF.
        height: Of its root's centre when it lies flat, m.
        torques: N m of every motor, which is numbered as the links are.
        speeds: rad/s of every motor.
        rest: Joint angles at which it lies flat, rad.
    """

    file: str
    height: float
    torques: tuple[float, ...]
    speeds: tuple[float, ...]
    rest: tuple[float, ...]

    @classmethod
    def of(cls, body: Morphology, folder: Path) -> Self:
        """Write it down."""
        folder.mkdir()
        joints = body.joints.values()
        return cls(
            file=str(write_urdf(body, folder)),
            height=body.resting_height(),
            torques=tuple(joint.torque for joint in joints),
            speeds=tuple(math.radians(joint.speed_deg) for joint in joints),
            rest=tuple(body.rest.tolist()),
        )


def new_world(step: float) -> int:
    """Ground and gravity; steps of so many seconds."""
    client = int(pybullet.connect(pybullet.DIRECT))
    pybullet.setGravity(0, 0, -9.81, physicsClientId=client)
    pybullet.setPhysicsEngineParameter(
        fixedTimeStep=step, numSolverIterations=50, deterministicOverlappingPairs=1, physicsClientId=client
    )
    plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
    ground = pybullet.createMultiBody(0, plane, physicsClientId=client)
    pybullet.changeDynamics(ground, -1, lateralFriction=1.0, physicsClientId=client)
    return client


def load(client: int, body: OnDisk, place: tuple[float, float] = (0, 0), yaw: float = 0) -> int:
    """Put it down flat."""
    turn = (0, 0, math.sin(yaw / 2), math.cos(yaw / 2))
    flags = pybullet.URDF_USE_INERTIA_FROM_FILE
    return int(pybullet.loadURDF(body.file, (*place, body.height), turn, flags=flags, physicsClientId=client))


def lie_down(client: int, robot: int, body: OnDisk) -> None:
    """Flat again; lifted off in between, for Bullet keeps what it touched."""
    for height in (body.height + 100, body.height):
        pybullet.resetBasePositionAndOrientation(robot, (0, 0, height), (0, 0, 0, 1), physicsClientId=client)
        pybullet.resetBaseVelocity(robot, (0, 0, 0), (0, 0, 0), physicsClientId=client)
        for motor, angle in enumerate(body.rest):
            pybullet.resetJointState(robot, motor, angle, 0.0, physicsClientId=client)
        if height > body.height:
            pybullet.performCollisionDetection(physicsClientId=client)


def drive(client: int, robot: int, body: OnDisk, targets: Vector) -> None:
    """Set every motor's target, rad."""
    for motor, (target, torque, speed) in enumerate(zip(targets, body.torques, body.speeds, strict=True)):
        pybullet.setJointMotorControl2(
            robot,
            motor,
            pybullet.POSITION_CONTROL,
            targetPosition=target,
            force=torque,
            maxVelocity=speed,
            physicsClientId=client,
        )


def settle(client: int, body: OnDisk, commands: Vector, *, looks: int, rest_speed: float) -> Vector:
    """(n, 4) orientation xyzw after each of the (n, joints) commands, looking every 12 steps whether it rests."""
    robot, motors = load(client, body), list(range(len(body.torques)))
    found = []
    for command in commands.tolist():
        lie_down(client, robot, body)
        drive(client, robot, body, command)
        for _ in range(looks):
            for _ in range(12):
                pybullet.stepSimulation(physicsClientId=client)
            _, turning = pybullet.getBaseVelocity(robot, physicsClientId=client)
            states = pybullet.getJointStates(robot, motors, physicsClientId=client)
            if max(*map(abs, turning), *(abs(state[1]) for state in states)) < rest_speed:
                break
        found.append(pybullet.getBasePositionAndOrientation(robot, physicsClientId=client)[1])
    pybullet.removeBody(robot, physicsClientId=client)
    return np.array(found)


def move(client: int, robot: int, body: OnDisk, targets: Vector, substeps: int) -> Vector:
    """(steps, 7) where the root is after each of the (steps, joints) targets."""
    motors, bases = list(range(len(body.torques))), []
    lie_down(client, robot, body)
    drive(client, robot, body, np.array(body.rest))
    for target in targets.tolist():
        drive(client, robot, body, target)
        for _ in range(substeps):
            pybullet.stepSimulation(physicsClientId=client)
        position, turn = pybullet.getBasePositionAndOrientation(robot, physicsClientId=client)
        pybullet.getJointStates(robot, motors, physicsClientId=client)
        bases.append((*position, *turn))
    return np.array(bases)
