"""Rigid bodies that move: a Bullet world in which bodies are addressed by name.

Both the world that the student stands in and the student's imagination of itself (Section 3.2.2, footnote 2: the
paper used ODE) are such a simulation, each with a client of its own. Bodies enter as URDF, the way any other
simulator would read them.

Bullet's limits, measured: stepping holds the GIL, so parallel work takes processes; adding and removing a body
leaks about 5 kB, so long searches re-use one simulation and never a process for ever.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Morphology, Sphere, Vector
from testbed.frames import tilt_of
from testbed.physics_bodies import Body, load_body, picture, unload, unseen
from testbed.silence import silence

with silence():  # importing it prints its build time
    import pybullet


__all__ = ["PhysicsSpec", "Simulation", "tilt_of"]

_OUT_OF_REACH = 100.0
_SEIZED = 100  # times a servo's torque: what turns a joint that has seized


@dataclass(frozen=True, kw_only=True)
class PhysicsSpec:
    """How finely the physics is computed.

    Attributes:
        step: Length of a physics step in seconds.
        gravity: Downward acceleration in m/s2.
        ground_friction: Coulomb coefficient of the ground; Bullet multiplies it with the part's.
        solver_iterations: Contact solver sweeps a step (Bullet's own default).
    """

    step: float = 1 / 240
    gravity: float = 9.81
    ground_friction: float = 1.0
    solver_iterations: int = 50


class Simulation:
    """A ground plane and any number of named bodies. Use as a context manager, or call :meth:`close`."""

    def __init__(self, spec: PhysicsSpec | None = None) -> None:
        self.spec = spec or PhysicsSpec()
        self.client = pybullet.connect(pybullet.DIRECT)
        self._bodies: dict[str, Body] = {}
        self._locked: dict[str, dict[str, float]] = {}
        self._told: dict[str, bytes] = {}  # the targets that the servos have
        pybullet.setGravity(0, 0, -self.spec.gravity, physicsClientId=self.client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=self.spec.step,
            numSolverIterations=self.spec.solver_iterations,
            deterministicOverlappingPairs=1,
            physicsClientId=self.client,
        )
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=self.client)
        ground = pybullet.createMultiBody(0, plane, unseen(self.client), physicsClientId=self.client)
        pybullet.changeDynamics(
            ground, -1, lateralFriction=self.spec.ground_friction, physicsClientId=self.client
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the simulation; harmless when repeated."""
        if self.client >= 0:
            pybullet.disconnect(self.client)
            self.client = -1

    def add(
        self,
        name: str,
        morphology: Morphology,
        *,
        place: tuple[float, float] = (0, 0),
        yaw: float = 0,
        height: float = 0,
        fixed: bool = False,
    ) -> None:
        """Put a body on the ground, lying flat.

        Args:
            name: What to call it.
            morphology: Its body.
            place: Ground coordinates of the root's centre, in metres.
            yaw: Heading of the root's x axis, rad, counter-clockwise from above.
            height: Of the unseen pedestal that it lies on, in metres; it carries nobody else.
            fixed: Whether it stays where it is whatever happens; then it needs no pedestal.
        """
        self._bodies[name] = load_body(
            self.client,
            morphology,
            place=place,
            yaw=yaw,
            height=height,
            fixed=fixed,
            ground_friction=self.spec.ground_friction,
        )
        self.reset(name)

    def remove(self, name: str) -> None:
        """Take a body out of the world."""
        self._locked.pop(name, None)
        self._told.pop(name, None)
        unload(self.client, self._bodies.pop(name))

    def replace(self, name: str, morphology: Morphology) -> None:
        """Give a body another shape where it is, in the posture that it has; what is new of it is flat."""
        base, angles = (
            self.base(name),
            dict(zip(self._bodies[name].morphology.joints, self.joints(name), strict=True)),
        )
        (*place, _), (*_, sine, cosine) = self._bodies[name].start
        self.remove(name)
        self.add(name, morphology, place=(place[0], place[1]), yaw=2 * math.atan2(sine, cosine))
        rest = dict(zip(morphology.joints, morphology.rest, strict=True))
        self.pose(name, base, np.array([angles.get(joint, rest[joint]) for joint in morphology.joints]))

    def lock(self, name: str, joint: str) -> None:
        """Seize a joint where it is: whatever is commanded, it stays there, until the body is reset."""
        index = list(self._bodies[name].morphology.joints).index(joint)
        self._told.pop(name, None)
        self._locked.setdefault(name, {})[joint] = float(self.joints(name)[index])

    def push(self, name: str, velocity: tuple[float, float]) -> None:
        """Set a ball rolling over the ground, at this velocity in m/s; any other body slides off."""
        part = self._bodies[name].morphology.parts[self._bodies[name].morphology.root]
        radius = part.radius if isinstance(part, Sphere) else math.inf
        x, y = velocity
        pybullet.resetBaseVelocity(
            self._bodies[name].number, (x, y, 0), (-y / radius, x / radius, 0), physicsClientId=self.client
        )

    def reset(self, *names: str) -> None:
        """Back to where the bodies were put: flat, at rest, and without memory of what they touched."""
        # Bullet keeps contact points with their impulses and starts the next step from them. Where a body returns
        # to nearly the same spot the old ones still fit; lifted out of reach of everything they are dropped.
        for name in names:
            body = self._bodies[name]
            (x, y, z), orientation = body.start
            self.pose(name, np.array([x, y, z + _OUT_OF_REACH, *orientation]), body.rest)
        pybullet.performCollisionDetection(physicsClientId=self.client)
        for name in names:
            self._locked.pop(name, None)
            self._told.pop(name, None)
            body = self._bodies[name]
            self.pose(name, np.array([*body.start[0], *body.start[1]]), body.rest)
            self.command(name, body.rest)

    def pose(self, name: str, base: NDArray[np.floating], joints: NDArray[np.floating]) -> None:
        """Set a body's state, at rest.

        Args:
            name: Which body.
            base: (7,) position (m) and quaternion xyzw of the root.
            joints: Joint angles, rad.
        """
        body = self._bodies[name]
        position, orientation = base[:3].tolist(), base[3:].tolist()
        pybullet.resetBasePositionAndOrientation(
            body.number, position, orientation, physicsClientId=self.client
        )
        pybullet.resetBaseVelocity(body.number, (0, 0, 0), (0, 0, 0), physicsClientId=self.client)
        for motor, angle in zip(body.motors, joints.tolist(), strict=True):
            pybullet.resetJointState(body.number, motor, angle, 0.0, physicsClientId=self.client)

    def command(self, name: str, targets: NDArray[np.floating]) -> None:
        """Set the servos' targets (rad); each turns there with its own finite torque and speed.

        A servo whose target is NaN is off: nothing holds its joint. Bullet is not told again what it was told before.
        """
        told = targets.tobytes()
        if self._told.get(name) == told:
            return
        self._told[name] = told
        body, locked = self._bodies[name], self._locked.get(name, {})
        servos = zip(
            body.morphology.joints, body.motors, targets.tolist(), body.torques, body.speeds, strict=True
        )
        for joint, motor, target, torque, speed in servos:
            if joint in locked:
                target, torque = locked[joint], torque * _SEIZED
            if math.isnan(target):
                target, torque = 0.0, 0.0
            pybullet.setJointMotorControl2(
                body.number,
                motor,
                pybullet.POSITION_CONTROL,
                targetPosition=target,
                force=torque,
                maxVelocity=speed,
                physicsClientId=self.client,
            )

    def step(self, count: int = 1) -> None:
        """Let ``count`` physics steps pass."""
        for _ in range(count):
            pybullet.stepSimulation(self.client)

    def follow(
        self, name: str, targets: NDArray[np.floating], substeps: int
    ) -> Iterator[tuple[tuple[float, ...], list[float]]]:
        """Give a body targets (steps, joints), rad, each for so many physics steps; yields base and joints."""
        body, client = self._bodies[name], self.client
        for target in targets:
            self.command(name, target)
            for _ in range(substeps):
                pybullet.stepSimulation(client)
            position, orientation = pybullet.getBasePositionAndOrientation(body.number, client)
            states = pybullet.getJointStates(body.number, body.motors, client) if body.motors else ()
            yield position + orientation, [state[0] for state in states]

    def base(self, name: str) -> Vector:
        """(7,) position (m) and quaternion xyzw of the root."""
        position, orientation = pybullet.getBasePositionAndOrientation(
            self._bodies[name].number, physicsClientId=self.client
        )
        return np.array([*position, *orientation])

    def joints(self, name: str) -> Vector:
        """Joint angles, rad, in the morphology's order."""
        body = self._bodies[name]
        if not body.motors:
            return np.zeros(0)
        states = pybullet.getJointStates(body.number, body.motors, physicsClientId=self.client)
        return np.array([state[0] for state in states])

    @property
    def bodies(self) -> Mapping[str, Morphology]:
        """The bodies by name, in the order in which they came."""
        return {name: body.morphology for name, body in self._bodies.items()}

    def frames(self, name: str) -> Vector:
        """(parts, 7) position (m) and quaternion xyzw of the centre of each part, in the morphology's order."""
        body = self._bodies[name]
        poses = {body.parts[0]: self.base(name)}
        if len(body.parts) > 1:
            links = list(range(len(body.parts) - 1))
            states = pybullet.getLinkStates(
                body.number, links, computeForwardKinematics=1, physicsClientId=self.client
            )
            for part, state in zip(body.parts[1:], states, strict=True):
                poses[part] = np.array([*state[0], *state[1]])
        return np.array([poses[part] for part in body.morphology.parts])

    def velocity(self, name: str) -> Vector:
        """(3,) velocity of the root's centre of mass in the world, m/s."""
        linear, _ = pybullet.getBaseVelocity(self._bodies[name].number, physicsClientId=self.client)
        return np.array(linear)

    def speed(self, name: str) -> float:
        """How fast anything about the body moves: the largest of its angular and joint speeds, rad/s."""
        body = self._bodies[name]
        _, angular = pybullet.getBaseVelocity(body.number, physicsClientId=self.client)
        speeds = [abs(rate) for rate in angular]
        if body.motors:
            states = pybullet.getJointStates(body.number, body.motors, physicsClientId=self.client)
            speeds += [abs(state[1]) for state in states]
        return float(max(speeds))

    def tilt(self, name: str) -> Vector:
        """(2,) tilt of the root, rad: about its x axis (to the side) and its y axis (positive nose-down)."""
        return tilt_of(self.base(name)[3:])

    def picture(
        self, view: tuple[float, ...], projection: tuple[float, ...], **how: Any
    ) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """What a pinhole camera sees: see :func:`testbed.physics_bodies.picture`."""
        return picture(self.client, view, projection, **how)
