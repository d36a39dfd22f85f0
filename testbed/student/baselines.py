"""The phases of baselines: who guesses, goes by distance or looks, or is told; see :mod:`testbed.student.phases`."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

import numpy as np

from testbed.bodies.morphology import Morphology, Vector
from testbed.student.body.self_model import BodyPrior
from testbed.student.forms import Modelled, Own, Told
from testbed.student.insider import Insider, Insight, KnownBody, insight
from testbed.student.judging import selfless
from testbed.student.judging.verdict import Verdict
from testbed.student.motion import Watched
from testbed.student.parameters import StudentParameters
from testbed.student.seeing.glance import Glance, glance
from testbed.student.senses import Senses


def ask(
    prior: BodyPrior,
    parameters: StudentParameters,
    senses: Senses,
    rng: np.random.Generator,
    told: Told,
    insider: Insider | None = None,
) -> Generator[Vector, Vector | None, KnownBody]:
    """Baseline: somebody says it."""
    assert insider is not None, "only a privileged mind may ask"
    told(1, 1)
    return KnownBody(insider.body)
    yield  # a generator that asks for no command


def look_once(
    watched: Watched,
    own: Own,
    senses: Senses,
    parameters: StudentParameters,
    rng: np.random.Generator,
    told: Told,
) -> Glance:
    """Baseline: how far away somebody is, and what it looks like."""
    return glance(watched, senses.rig, own.body, parameters.glance, rng)


def be_told(
    watched: Watched,
    own: Own,
    senses: Senses,
    parameters: StudentParameters,
    rng: np.random.Generator,
    told: Told,
) -> Insight:
    """Baseline: the truth."""
    assert own.told is not None, "only a privileged mind may ask"
    return insight(watched.times, own.told(), own.prior.part_count)


def not_tried(
    model: Modelled,
    body: Morphology,
    senses: Senses,
    parameters: StudentParameters,
    rng: np.random.Generator,
    told: Told,
) -> None:
    """Baseline: who only looks at others does not move."""


def stay(
    model: Modelled,
    imitation: None,
    body: Morphology,
    senses: Senses,
    parameters: StudentParameters,
    rng: np.random.Generator,
    told: Told,
) -> Vector:
    """Baseline: no commands."""
    return np.empty((0, len(body.joints)))


def by_chance(
    model: Any,
    imitation: Any,
    body: Morphology,
    parameters: StudentParameters,
    rng: np.random.Generator,
) -> Verdict:
    """Baseline: a coin."""
    return selfless.by_chance(rng)


def by_distance(
    model: Glance,
    imitation: Any,
    body: Morphology,
    parameters: StudentParameters,
    rng: np.random.Generator,
) -> Verdict:
    """Baseline: the nearest is the best."""
    return selfless.by_distance(model, parameters.glance)


def by_look(
    model: Glance,
    imitation: Any,
    body: Morphology,
    parameters: StudentParameters,
    rng: np.random.Generator,
) -> Verdict:
    """Baseline: who looks most like the own kind is the best."""
    return selfless.by_look(model, parameters.glance)
