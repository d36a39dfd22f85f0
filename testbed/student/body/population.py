"""Which self-models live on, and how much each has to say."""

from __future__ import annotations

import math

import numpy as np

from testbed.bodies.morphology import Vector
from testbed.student.body.genomes import Genomes
from testbed.student.body.self_model import Tree
from testbed.student.parameters import ActiveDiscoveryParameters


def tempered(log_posterior: Vector, freedom: float) -> Vector:
    """Weights that sum to one, flattened until at least ``freedom`` of them count (inverse sum of squares)."""
    logs = log_posterior - log_posterior.max()
    weights = np.exp(logs)
    for heat in 1.5 ** np.arange(30):
        weights = np.exp(logs / heat)
        weights /= weights.sum()
        if 1 / np.sum(weights**2) >= min(freedom, 0.8 * len(logs)):
            break
    return np.asarray(weights)


def spread_evenly(weights: Vector, count: int) -> list[int]:
    """``count`` indices in proportion to weights that sum to one, without chance."""
    marks = (np.arange(count) + 0.5) / count
    return [int(i) for i in np.minimum(np.searchsorted(np.cumsum(weights), marks), len(weights) - 1)]


def survivors(people: Genomes, log_posterior: Vector, parameters: ActiveDiscoveryParameters) -> list[int]:
    """Which self-models stay: the best that are distinct, and the best few of every topology."""
    order = np.argsort(-log_posterior)
    trees, angles = people.trees, people.angles
    members: dict[Tree, list[int]] = {}
    distinct: list[int] = []
    for row in order.tolist():
        kin = members.setdefault(trees[row], [])
        apart = np.abs(np.angle(np.exp(1j * (angles[kin] - angles[row])))).max(axis=1, initial=0.0)
        if not kin or apart.min() > math.radians(parameters.distinct_deg):
            kin.append(row)
            distinct.append(row)
    if len(members) * parameters.per_tree <= parameters.population:
        protected = {row for kin in members.values() for row in kin[: parameters.per_tree]}
    else:
        protected = set()
    room = parameters.population - len(protected)
    others = [row for row in distinct if row not in protected]
    kept = protected | set(others[:room])
    return [row for row in distinct if row in kept]
