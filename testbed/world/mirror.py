"""Which joint of a body does in a mirror what another one does."""

from __future__ import annotations

import numpy as np

from testbed.bodies.morphology import Morphology

_CLOSE = 1e-3
# Left and right are exchanged, and a turn about an axis becomes one about the axis's image, backwards.
_PLACE = np.array([1.0, -1.0, 1.0])
_AXIS = np.array([-1.0, 1.0, -1.0])


def twins(body: Morphology) -> list[int]:
    """For each joint the one on the other side of the body's own x-z plane; itself where there is none.

    Two joints are twins if a mirror in that plane takes one's hinge on the flat body to the other's, and their limbs
    have the same shape.
    """
    flat = body.poses(np.zeros(len(body.joints)))
    hinges = [flat[joint.parent] @ body.mount(joint) for joint in body.joints.values()]
    limbs = [body.parts[joint.child] for joint in body.joints.values()]
    size = max(float(np.abs(hinge[:3, 3]).max()) for hinge in hinges) if hinges else 1.0
    found = []
    for index, hinge in enumerate(hinges):
        place, axis = hinge[:3, 3] * _PLACE, hinge[:3, 1] * _AXIS
        matches = [
            other
            for other, there in enumerate(hinges)
            if np.abs(there[:3, 3] - place).max() <= _CLOSE * size
            and np.abs(there[:3, 1] - axis).max() <= _CLOSE
            and limbs[other].shape == limbs[index].shape
        ]
        found.append(index if index in matches or not matches else matches[0])
    return found
