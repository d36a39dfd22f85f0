"""Bodies drawn from the posterior by importance sampling around the best self-models (after Section 3.2)."""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp

from testbed.bodies.morphology import Vector
from testbed.student.body.genomes import Foresight, Genomes
from testbed.student.body.plausibility import Felt, judge_bodies
from testbed.student.parameters import PlausibilityParameters


def sample_posterior(
    modes: Genomes,
    covariances: Vector,
    mind: Foresight,
    felt: Felt,
    beliefs: PlausibilityParameters,
    count: int,
    rng: np.random.Generator,
) -> tuple[Genomes, Vector, Vector, Vector]:
    """Weighted bodies: drawn around the modes, and weighted by how plausible against how often drawn.

    Args:
        modes: (k,) distinct self-models, all plausible.
        covariances: (k, 3 n, 3 n) of their values.
        mind: Imagines tilt; ``count`` evaluations are spent.
        felt: What was felt.
        beliefs: What is plausible.
        count: How many bodies to draw.
        rng: Source of chance.

    Returns:
        Bodies, weights (s,) that sum to one, log posteriors (s,) and biases (s, 2).
    """
    size = modes.values.shape[1]
    limbs = size // 3
    ups = mind.relive(modes, felt, beliefs)
    heights = judge_bodies(ups, modes.values, felt, beliefs).log_posterior
    _, half_logs = np.linalg.slogdet(covariances)
    evidence = heights + 0.5 * half_logs
    shares = np.exp(0.5 * (evidence - evidence.max()))  # half the logarithm: no mode goes without samples
    shares = np.maximum(shares / shares.sum(), 0.3 / len(modes))
    shares /= shares.sum()
    picks = np.repeat(np.arange(len(modes)), rng.multinomial(count, shares))
    freedom = 6.0
    stretch = np.sqrt(freedom / rng.chisquare(freedom, len(picks)))[:, None]
    roots = np.stack([_root(covariance) for covariance in covariances])
    noise = np.einsum("pij,pj->pi", roots[picks], rng.normal(size=(len(picks), size))) * stretch
    values = modes.values[picks] + noise
    values[:, :limbs] = np.angle(np.exp(1j * values[:, :limbs]))
    drawn = Genomes(modes.parents[picks], values)
    fit = judge_bodies(mind.relive(drawn, felt, beliefs), values, felt, beliefs)
    inverses = np.linalg.inv(covariances)
    way = values[:, None] - modes.values[None]
    way[..., :limbs] = np.angle(np.exp(1j * way[..., :limbs]))
    squares = np.einsum("ski,kij,skj->sk", way, inverses, way)
    same = np.all(drawn.parents[:, None] == modes.parents[None], axis=2)
    density = np.log(shares) - 0.5 * half_logs - (freedom + size) / 2 * np.log1p(squares / freedom)
    density = logsumexp(np.where(same, density, -np.inf), axis=1)
    return drawn, settled_weights(fit.log_posterior - density), fit.log_posterior, fit.bias


def settled_weights(logs: Vector, *, fewest: float = 25.0) -> Vector:
    """Importance weights that sum to one, flattened until at least ``fewest`` samples count."""
    for heat in 1.3 ** np.arange(40):
        weights = np.exp((logs - logs.max()) / heat)
        weights /= weights.sum()
        if 1 / np.sum(weights**2) >= min(fewest, 0.3 * len(logs)):
            break
    return np.asarray(weights)


def _root(covariance: Vector) -> Vector:
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
