"""How hands hold the calibration board before an emulated rig."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from testbed.bodies.morphology import Vector
from testbed.frames import rotation_about
from testbed.hardware.calibration.charuco import CharucoSpec
from testbed.hardware.emulation.lens import SIZE, Lens


def held(
    spec: CharucoSpec,
    *,
    u: float,
    v: float,
    distance: float,
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Vector:
    """(4, 4) pose of a board in the rig frame.

    Args:
        spec: Its size.
        u: Where an eye between the two cameras sees its middle, from -1 (left rim) to 1 (right rim).
        v: Likewise, from -1 (upper rim) to 1 (lower rim).
        distance: Of its middle, along the rig's axis, m.
        turn: Rotation vector (rad) from facing the rig, upright.
    """
    lens = Lens()
    pose = rotation_about(turn)
    middle = np.array([spec.extent[0] / 2, spec.extent[1] / 2, 0.0])
    place = distance * np.array([u * SIZE[0] / 2 / lens.focal[0], v * SIZE[1] / 2 / lens.focal[1], 1.0])
    pose[:3, 3] = place - pose[:3, :3] @ middle
    return pose


def held_about(spec: CharucoSpec, rng: np.random.Generator, count: int = 25) -> Iterator[Vector]:
    """Poses (4, 4) as somebody holds it who was told to fill the image and to tilt it each way."""
    for k in range(count):
        column, row = k % 4, (k // 4) % 3
        u = (column - 1.5) / 2 + rng.uniform(-0.12, 0.12)
        v = (row - 1) / 1.6 + rng.uniform(-0.12, 0.12)
        way = rng.uniform(0, math.tau)
        slant = math.radians(rng.uniform(10, 38))
        roll = math.radians(rng.uniform(-15, 15))
        turn = (slant * math.cos(way), slant * math.sin(way), roll)
        yield held(spec, u=u, v=v, distance=rng.uniform(0.33, 0.6), turn=turn)


def held_as_asked(spec: CharucoSpec, details: Mapping[str, float | str], rng: np.random.Generator) -> Vector:
    """The pose (4, 4) of a board held by hands that were asked to, as well as hands do it.

    Args:
        spec: The board's size.
        details: Of :class:`~testbed.hardware.calibration.coverage.Wish`; an upright board is set down with a set
            square.
        rng: The hands' imprecision.
    """
    wanted = {key: float(value) for key, value in details.items() if not isinstance(value, str)}
    sloppy = 0.0 if "upright" in details else 1.0
    lean_x, lean_y, roll = (
        math.radians(degrees + sloppy * rng.normal(0, 4))
        for degrees in (wanted["lean_x_deg"], wanted["lean_y_deg"], 0.0)
    )
    return held(
        spec,
        u=wanted["u"] + sloppy * rng.normal(0, 0.05),
        v=wanted["v"] + sloppy * rng.normal(0, 0.05),
        distance=wanted["distance"] * (1 + sloppy * rng.normal(0, 0.04)),
        turn=(lean_x, lean_y, roll),
    )
