"""Puts the things that are no robots into a simulated world."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from testbed.bodies.morphology import Morphology
from testbed.bodies.parts import CappedCylinder
from testbed.physics import Simulation
from testbed.scenario.clutter import ClutterSpec

_UPRIGHT = -math.pi / 2  # a post lies along x until it is put up


def put_clutter(simulation: Simulation, clutter: Iterable[ClutterSpec]) -> None:
    """Every thing on its spot, where it stays; they are called ``clutter_0``, ``clutter_1``, ..."""
    for number, spec in enumerate(clutter):
        name, part = f"clutter_{number}", spec.part
        simulation.add(name, Morphology(name="thing", parts={"thing": part}), fixed=True)
        bearing = math.radians(spec.bearing_deg)
        yaw = (math.radians(spec.facing_deg) - bearing) / 2
        pitch = _UPRIGHT / 2 if isinstance(part, CappedCylinder) else 0.0
        middle = spec.height + (spec.size[-1] / 2)
        place = spec.distance * math.sin(bearing), spec.distance * math.cos(bearing), middle
        turn = (
            -math.sin(yaw) * math.sin(pitch),
            math.cos(yaw) * math.sin(pitch),
            math.sin(yaw) * math.cos(pitch),
            math.cos(yaw) * math.cos(pitch),
        )
        simulation.pose(name, np.array([*place, *turn]), np.zeros(0))
