"""The simulated backend: the scenario's robots and stereo rig in a Bullet world."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Morphology, Vector
from testbed.physics import PhysicsSpec, Simulation, tilt_of
from testbed.scenario import RigSpec, Scenario
from testbed.scenario.view import MOST_PAN_ERRORS
from testbed.vision.noise import QuickNoise
from testbed.world.analytic import AnalyticRenderer
from testbed.world.backend import Pair
from testbed.world.clutter import put_clutter
from testbed.world.events import events_of
from testbed.world.flaws import Flaws, Lag
from testbed.world.optics import luminosities, projection_matrix, read_out, view_matrix
from testbed.world.placement import STUDENT, placements, teacher_names

IMAGE = (75, 100)
"""Rows and columns of the student's images (Section 3.3.3)."""

_ELSEWHERE = 100.0  # metres above where it was: who is away is beyond all that cameras see
_PEOPLE_LIGHT = {"lightDirection": (1.0, -2.0, 3.0), "lightAmbientCoeff": 0.6, "lightDiffuseCoeff": 0.4}


def bodies_of(scenario: Scenario) -> dict[str, Morphology]:
    """Everybody's body by agent name, the student first."""
    bodies = (scenario.student.body(), *(teacher.body() for teacher in scenario.teachers))
    return dict(zip((STUDENT, *teacher_names(scenario)), bodies, strict=True))


def physics_of(scenario: Scenario) -> PhysicsSpec:
    """The physics of the scenario's world."""
    world = scenario.world
    return PhysicsSpec(step=world.physics_step, gravity=world.gravity, ground_friction=world.ground_friction)


class SimulatedBackend:
    """A :class:`~testbed.world.backend.Backend` in which Bullet computes what happens and what is seen.

    Beyond the protocol it tells the truth (:meth:`state`), which the world never passes on to an agent.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._robots = bodies_of(scenario)
        self._spots = placements(scenario, self._robots)
        self._true = {**self._robots, STUDENT: scenario.student.true_body()}
        self._flaws = Flaws.of(scenario.student, self._robots[STUDENT])
        self._lag = Lag.of(scenario.student, self._robots[STUDENT], scenario.world.control_step)
        self._events = events_of(scenario, self._spots, self._robots)
        self._ways = {
            name: np.array([math.cos(spot.yaw), math.sin(spot.yaw)]) for name, spot in self._spots.items()
        }
        self._tilt_noise = math.radians(scenario.world.tilt_noise_deg)
        self._control_step = scenario.world.control_step
        self._bases: dict[str, Vector] = {}  # where everybody is, asked of Bullet once a step
        self._simulation = Simulation(physics_of(scenario))
        for name, body in self._true.items():
            spot = self._spots[name]
            self._simulation.add(name, body, place=spot.place, yaw=spot.yaw, height=spot.height)
        put_clutter(self._simulation, scenario.world.clutter)
        world, rig = scenario.world, scenario.rig
        self._substeps = world.physics_steps
        self._pan_step = math.radians(rig.pan_speed_deg) * world.control_step
        self._steps_per_frame = max(1, round(1 / (rig.camera_rate * world.control_step)))
        self._pan = 0.0
        self._views: tuple[float, list[tuple[float, ...]]] = math.nan, []  # of the eyes, for a pan
        self._now = dict(self._true)
        analytic = rig.renderer == "analytic"
        self._analytic = AnalyticRenderer(self._simulation, rig, IMAGE) if analytic else None
        self.reset(np.random.SeedSequence(scenario.seed))

    @property
    def robots(self) -> Mapping[str, Morphology]:
        """See :class:`Backend`."""
        return self._robots

    @property
    def pan(self) -> float:
        """See :class:`Backend`."""
        return self._pan

    def reset(self, seeds: np.random.SeedSequence) -> None:
        """See :class:`Backend`."""
        camera, *tilts, servo = seeds.spawn(2 + len(self._robots))
        self._camera_rng, self._pan_rng = np.random.default_rng(camera), np.random.default_rng(servo)
        if self._analytic is not None:
            self._camera_rng = QuickNoise(self._camera_rng.bit_generator)
        self._tilt_rngs = dict(zip(self._robots, map(np.random.default_rng, tilts), strict=True))
        self._drop_rng = np.random.default_rng(seeds.spawn(1)[0])
        self._pan, self._step = 0.0, 0
        self._frame: tuple[int, Pair] | None = None
        self._exposed = 0
        self._absent: dict[str, tuple[Vector, Vector]] = {}
        self._pan_target, self._pan_error = 0.0, 0.0
        if self._now != self._true:
            self._simulation.replace(STUDENT, self._true[STUDENT])
            self._now = dict(self._true)
        self._kept = np.full(len(self._robots[STUDENT].joints), True)  # commands that still move something
        self._lag.reset()
        for event in self._events:
            event.reset()
        self._simulation.reset(*self._robots)
        self._before, self._turned = self._simulation.joints(STUDENT), 0.0
        self._bases.clear()

    def apply(self, commands: Mapping[str, Vector], pan: float) -> None:
        """See :class:`Backend`."""
        for event in self._events:
            event.happen(self, self._step)
        for name, targets in commands.items():
            if name == STUDENT:
                targets = self._lag.heard(self._flaws.turned(targets))[self._kept]
            self._simulation.command(name, targets)
        self._simulation.step(self._substeps)
        self._bases.clear()
        self._feel_movement()
        if pan != self._pan_target:
            self._pan_target = pan
            deviation = np.clip(self._pan_rng.standard_normal(), -MOST_PAN_ERRORS, MOST_PAN_ERRORS)
            self._pan_error = math.radians(self._scenario.rig.pan_error_deg) * float(deviation)
        way = pan + self._pan_error - self._pan
        self._pan += min(max(way, -self._pan_step), self._pan_step)  # np.clip takes longer
        self._step += 1

    def tilt(self, robot: str) -> Vector:
        """See :class:`Backend`."""
        felt = tilt_of(self._base(robot)[3:]) + self._tilt_rngs[robot].normal(0.0, self._tilt_noise, 2)
        return felt + self._flaws.tilt_bias if robot == STUDENT else felt

    def progress(self, robot: str) -> float:
        """See :class:`Backend`."""
        return float((self._base(robot)[:2] - self._spots[robot].place) @ self._ways[robot])

    def movement(self, robot: str) -> float:
        """See :class:`Backend`; known of the student alone, whom everybody sees."""
        return self._turned if robot == STUDENT else 0.0

    def look(self, wanted: bool = True) -> Pair:
        """See :class:`Backend`. A new frame comes at the camera's rate; between two frames the last one stays."""
        frame = self._step // self._steps_per_frame
        if self._frame is None or self._frame[0] != frame:
            drops = self._scenario.rig.frame_drops
            # Also if it is lost: those that arrive are the same without losses. What is kept for a lost one is wanted.
            taken = self._expose_pair() if wanted or drops else self._pass_over_pair()
            lost = self._drop_rng.random() < drops
            if self._frame is None or not lost:
                self._exposed = self._step
            self._frame = (frame, self._frame[1] if lost and self._frame is not None else taken)
        return self._frame[1]

    def picture(self, width: int, height: int) -> NDArray[np.uint8]:
        """See :class:`Backend`."""
        eye, target = np.array([0.9, -2.1, 1.3]), np.array([0.0, 0.1, 0.0])
        return _photograph(self._simulation, eye, target, width, height, math.radians(55))

    @property
    def exposed(self) -> int:
        """See :class:`Backend`."""
        return self._exposed

    def state(self, robot: str) -> tuple[Vector, Vector]:
        """The truth about a robot: base (7,) position (m) and quaternion of its root, joint angles (rad).

        There are as many angles as the robot has commands; those of lost limbs are zero.
        """
        joints = self._simulation.joints(robot)
        if robot == STUDENT and len(joints) < len(self._kept):
            angles = np.zeros(len(self._kept))
            angles[self._kept] = joints
            joints = angles
        return self._base(robot).copy(), joints

    def bodies_now(self) -> Mapping[str, Morphology]:
        """The truth about the bodies: with the reality gap, and without what was lost."""
        return self._now

    def lose(self, limb: str) -> None:
        """A limb of the student falls off and is gone, with all that hangs on it."""
        body = self._now[STUDENT].without(limb)
        self._now = {**self._now, STUDENT: body}
        self._kept = np.array([joint in body.joints for joint in self._robots[STUDENT].joints])
        self._simulation.replace(STUDENT, body)
        self._bases.clear()

    def lock(self, joint: str) -> None:
        """A joint of the student seizes where it is."""
        if joint in self._now[STUDENT].joints:
            self._simulation.lock(STUDENT, joint)

    def push(self, robot: str, velocity: tuple[float, float]) -> None:
        """A robot is given a velocity over the ground (m/s)."""
        self._simulation.push(robot, velocity)

    def remove(self, robot: str) -> None:
        """A robot is out of sight in this step."""
        if robot not in self._absent:
            self._absent[robot] = self._simulation.base(robot), self._simulation.joints(robot)
        base, joints = self._absent[robot]
        self._simulation.pose(robot, np.array([*base[:2], base[2] + _ELSEWHERE, *base[3:]]), joints)
        self._bases.clear()

    def bring_back(self, robot: str) -> None:
        """A robot that was out of sight is where it was."""
        if robot in self._absent:
            self._simulation.pose(robot, *self._absent.pop(robot))
            self._bases.clear()

    def close(self) -> None:
        """See :class:`Backend`."""
        self._simulation.close()

    def _base(self, robot: str) -> Vector:
        base = self._bases.get(robot)
        if base is None:
            base = self._bases[robot] = self._simulation.base(robot)
        return base

    def _feel_movement(self) -> None:
        """How fast the student's fastest limb turned in the step that has passed, rad/s."""
        now = self._simulation.joints(STUDENT)
        same_body = len(now) == len(self._before)
        way = max(map(abs, (now - self._before).tolist()), default=0.0) if same_body else 0.0
        self._turned = way / self._control_step
        self._before = now

    def _expose_pair(self) -> Pair:
        rig = self._scenario.rig
        places = eyes(rig, self._pan)
        pictures = self._analytic.pictures(places, self._pan) if self._analytic else self._pictures(places)
        exposed = [
            read_out(
                picture,
                shape=IMAGE,
                noise=rig.camera_noise,
                rng=self._camera_rng,
                blur=rig.blur,
                gain=rig.gain,
            )
            for picture in pictures
        ]
        return np.stack(exposed)

    def _pass_over_pair(self) -> Pair:
        """White, with the noise drawn that it would have had: what is seen later does not depend on it."""
        for _ in range(2):
            self._camera_rng.normal(0.0, self._scenario.rig.camera_noise, IMAGE)
        return np.full((2, *IMAGE), 255, np.uint8)

    def _pictures(self, places: Vector) -> Iterator[NDArray[np.float32]]:
        """What cameras at these places (m, 3) see, by Bullet's renderer."""
        rig = self._scenario.rig
        width, height = IMAGE[1] * rig.supersample, IMAGE[0] * rig.supersample
        projection = projection_matrix(math.radians(rig.field_of_view_deg), width, height)
        if self._views[0] != self._pan:
            ahead = np.array([math.sin(self._pan), math.cos(self._pan), 0.0])
            self._views = self._pan, [view_matrix(place, place + ahead) for place in places]
        for view in self._views[1]:
            drawn = self._simulation.picture(view, projection, width=width, height=height, light=_light(rig))
            yield luminosities(*drawn, rig.background)


def eyes(rig: RigSpec, pan: float) -> Vector:
    """(2, 3) where the left and the right camera are in the world when the rig looks in direction ``pan``."""
    right = np.array([math.cos(pan), -math.sin(pan), 0.0])
    post = np.array([0.0, 0.0, rig.height])
    return np.stack([post - right * rig.baseline / 2, post + right * rig.baseline / 2])


def _photograph(
    simulation: Simulation, eye: Vector, target: Vector, width: int, height: int, field: float
) -> NDArray[np.uint8]:
    projection = projection_matrix(field, width, height)
    colours, seen = simulation.picture(
        view_matrix(eye, target), projection, width=width, height=height, light=_PEOPLE_LIGHT
    )
    return np.where(seen[..., None], colours[..., :3], np.uint8(255))


def _light(rig: RigSpec) -> dict[str, object]:
    light = rig.light
    return {
        "lightDirection": light.direction,
        "lightAmbientCoeff": light.ambient,
        "lightDiffuseCoeff": light.diffuse,
        "lightSpecularCoeff": light.specular,
        "shadow": 0,
    }
