"""Three robots around a stereo rig: cameras with bent lenses, and what is true of them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import load_robot
from testbed.hardware.clock import StillClock
from testbed.hardware.emulation.cameras import emulated_pair
from testbed.hardware.emulation.lens import RigTruth, built_rig
from testbed.hardware.emulation.scenes import RobotScene
from testbed.hardware.emulation.truth import true_backdrop, true_calibration
from testbed.hardware.rig.stereo_rig import StereoRig
from testbed.physics import Simulation
from testbed.scenario.specs import RigSpec
from testbed.vision.camera import StereoRig as StudentRig

EYES = StudentRig()

DARK_BELOW = 180


class Bench:
    """Three robots around a rig that turns."""

    def __init__(self, rig: RigTruth | None = None) -> None:
        self.simulation = Simulation()
        self.pan = 0.0
        for name, bearing, distance, yaw in (
            ("a", -35, 0.85, 25),
            ("b", 30, 0.95, -30),
            ("c", 85, 0.8, -80),
        ):
            place = (
                distance * math.sin(math.radians(bearing)) - 0.2 * math.cos(math.radians(yaw)),
                distance * math.cos(math.radians(bearing)) - 0.2 * math.sin(math.radians(yaw)),
            )
            self.simulation.add(name, load_robot("crawler"), place=place, yaw=math.radians(yaw))
            self.simulation.command(name, np.array([0.7, -0.5]))
        self.simulation.step(100)
        self.clock = StillClock(100.0)
        self.truth = rig or built_rig(np.random.default_rng(5))
        self.scene = RobotScene(self.simulation, RigSpec(), lambda: self.pan)
        self.left, self.right = emulated_pair(self.truth, self.scene, self.clock)
        self.calibration = true_calibration(self.truth)
        self.backdrop = true_backdrop(self.calibration, EYES, self.truth.sensor)

    def renewed(self) -> Bench:
        """The same world with cameras that nothing is wrong with."""
        self.pan, self.clock = math.radians(-35), StillClock(100.0)
        self.left, self.right = emulated_pair(self.truth, self.scene, self.clock)
        return self

    def rig(self) -> StereoRig:
        return StereoRig(self.left, self.right, self.calibration, self.backdrop, self.clock, eyes=EYES)

    def looks(self, rig: StereoRig, count: int) -> NDArray[np.uint8]:
        for _ in range(count):
            self.clock.sleep(1 / 15)
            seen = rig.look()
        return seen
