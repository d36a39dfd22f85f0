"""Where servos are on the way to what they are told: Bullet's position motor in closed form, without its load.

In each physics step such a motor turns by a share of what is missing, and no faster than its speed allows (Section
3.2.2 leaves motors to the simulator). A crawler's motors are so strong that its weight hardly counts: over gaits with
periods of 1.5 to 3 s this is .003 deg from the simulated angles in the median, where the commands are 1.9 deg ahead.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from testbed.bodies.morphology import Vector
from testbed.student.parameters import ImaginationParameters
from testbed.vision._jit import compiled


@dataclass(frozen=True)
class Servos:
    """The time that servos have, and how eager they are.

    Attributes:
        control_step: Seconds between two commands; no default, for it is the world's.
        physics_step: Seconds between two corrections of the motor; as the imagination has it by default.
        gain: Share of the missing angle that is turned in a physics step: Bullet's own default.
    """

    control_step: float
    physics_step: float = ImaginationParameters().physics_step
    gain: float = 0.1

    def angles(self, targets: Vector, start: Vector, speeds: Vector) -> Vector:
        """Joint angles (steps, joints) at the end of each control step, rad.

        Args:
            targets: (steps, joints) rad, one a control step.
            start: (joints,) rad, before the first.
            speeds: (joints,) the fastest that each turns, rad/s.
        """
        substeps = max(1, round(self.control_step / self.physics_step))
        most = speeds * self.control_step / substeps
        reached = np.empty(np.shape(targets))
        _turn(np.ascontiguousarray(targets, dtype=float), start, most, self.gain, substeps, reached)
        return reached


@compiled
def _turn(targets: Vector, start: Vector, most: Vector, gain: float, substeps: int, reached: Vector) -> None:
    """Fill ``reached`` (steps, joints), rad; ``most`` (joints,) is what each turns in a physics step at most, rad."""
    for joint in range(len(start)):
        angle = start[joint]
        for step in range(len(targets)):
            for _ in range(substeps):
                way = gain * (targets[step, joint] - angle)
                angle += max(-most[joint], min(most[joint], way))
            reached[step, joint] = angle
