"""Compiled: many bodies made of the same parts, each brought to rest after the same commands."""

from __future__ import annotations

import numpy as np

from testbed.bodies.morphology import Vector
from testbed.student.body._postures import BALL, CAPPED, Indices, place_hinge
from testbed.student.body._settling import settle_commands
from testbed.vision._jit import compiled


@compiled
def settle_candidates(
    parents: Indices,
    orders: Indices,
    angles: Vector,
    offsets: Vector,
    stretches: Vector,
    gains: Vector,
    hinges: Vector,
    shapes: Vector,
    masses: Vector,
    speeds: Vector,
    commands: Vector,
    increment: float,
    starts: Vector,
    there: bool,
    ups: Vector,
    haste: Vector,
) -> None:
    """How bodies that have the same parts, differently joined, come to rest after each command.

    Args:
        parents: (c, n) of each candidate.
        orders: (c, n) likewise.
        angles: (c, n) mounting angles, rad.
        offsets: (c, n) what the servos add to their command, rad.
        stretches: (c, n) factors of the limbs' lengths; zero is a limb that is lost.
        gains: (c, n) how much of its command a servo follows: 1, or 0 where a joint is locked at its offset.
        hinges: (n, 2) place along and above the part that a limb hangs on.
        shapes: (n + 1, 4) before stretching.
        masses: (n + 1,) before stretching.
        speeds: (n,) relative to each other.
        commands: (m, n) rad.
        increment: As :func:`settle_commands` takes it.
        starts: Likewise, (m, 3).
        there: Likewise.
        ups: (c, m, 3) out: the world's up in the root's frame.
        haste: (c, m) out: as in the last column there.
    """
    limbs = len(speeds)
    mounts, sizes, weights = np.empty((limbs, 5)), shapes.copy(), masses.copy()
    targets, poses = np.empty((len(commands), limbs)), np.empty((len(commands), 10))
    for candidate in range(len(parents)):
        for limb in range(limbs):
            place = 2 if int(shapes[limb + 1, 0]) == CAPPED else 1
            caps = 4 / 3 * shapes[limb + 1, 1] if place == 2 else 0.0  # they keep their size
            length = shapes[limb + 1, place]
            stretched = length * stretches[candidate, limb]
            sizes[limb + 1, place] = stretched
            sizes[limb + 1, 0] = shapes[limb + 1, 0]
            weights[limb + 1] = masses[limb + 1] * (stretched + caps) / (length + caps)
            # In loops, here and below: numba compiles an array assignment for seconds (its error message, mostly).
            for step in range(len(commands)):
                turn = commands[step, limb] * gains[candidate, limb] + offsets[candidate, limb]
                targets[step, limb] = turn
            if stretched == 0.0:  # a weightless speck in the hinge: its parent touches first
                sizes[limb + 1, 0], sizes[limb + 1, 1], weights[limb + 1] = BALL, 0.0, 0.0
            else:
                sizes[limb + 1, 3 - place] = shapes[limb + 1, 3 - place]
        for limb in range(limbs):
            carrier = sizes[parents[candidate, limb]]
            place_hinge(carrier, angles[candidate, limb], hinges[limb, 0], hinges[limb, 1], mounts[limb])
        settle_commands(
            parents[candidate],
            orders[candidate],
            mounts,
            sizes,
            weights,
            speeds,
            targets,
            increment,
            starts,
            there,
            poses,
        )
        for step in range(len(commands)):
            for axis in range(3):
                ups[candidate, step, axis] = poses[step, axis]
            haste[candidate, step] = poses[step, 9]
