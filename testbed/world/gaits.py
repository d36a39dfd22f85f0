"""How teachers move: scripted policies that act through the same ``step`` as everybody else.

A new behaviour is a class with ``act`` and one line in ``_POLICIES``; a new gait of a known kind is one line in
``PRESETS`` or a block in a scenario file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np

from testbed.errors import UserError
from testbed.morphology import Morphology, Vector
from testbed.scenario_teacher import GaitSpec, JointWave, waved

ATTENTION = math.radians(10)
"""A rig whose axis passes a teacher by less than this is watching it (rad); well under half the field of view, so
that two teachers who do not share a view are never both watched."""

PRESETS: dict[str, GaitSpec] = {
    "still": GaitSpec(kind="still"),
    "random": GaitSpec(kind="random"),
    "roll": GaitSpec(kind="push"),
    # Reach out with the foot lifted, put it down, pull: 5 cm a cycle for the crawler, for its foot grips better
    # than its body; with one coefficient of friction it stays where it is.
    "crawl": GaitSpec(
        period=2.0,
        joints={
            "joint_a": JointWave(centre_deg=0, amplitude_deg=33),
            "joint_b": JointWave(centre_deg=65, amplitude_deg=25, phase_deg=120),
        },
    ),
    # One limb props the body up while the other rows: 8 cm a cycle for the splayed body, by shifting load between
    # limbs and body; it would even work with one coefficient of friction.
    "splayed_crawl": GaitSpec(
        period=2.0,
        joints={
            "joint_a": JointWave(centre_deg=-28, amplitude_deg=19),
            "joint_b": JointWave(centre_deg=54, amplitude_deg=28, phase_deg=156),
        },
    ),
}


def preset_names() -> tuple[str, ...]:
    """Names of the gaits that a scenario can use without spelling them out."""
    return tuple(PRESETS)


class Policy(Protocol):
    """Anybody who acts: observations in, joint targets (rad) out."""

    def act(self, observation: Mapping[str, Vector]) -> Vector:
        """The next action."""
        ...


class Still:
    """Lies flat for ever."""

    def __init__(self, gait: GaitSpec, body: Morphology, control_step: float) -> None:
        self._rest = body.rest

    def act(self, observation: Mapping[str, Vector]) -> Vector:
        """The body's rest."""
        return self._rest


class Cyclic:
    """Every joint follows its wave, see :class:`testbed.scenario.JointWave`; t is the time since the gait began.

    A gait that waits to be watched starts afresh whenever the student's rig turns to the teacher, and lies flat
    while it looks elsewhere: a teacher that crawled all the time would be out of sight before the student is done
    discovering itself.
    """

    def __init__(self, gait: GaitSpec, body: Morphology, control_step: float) -> None:
        waves = [gait.joints.get(joint, JointWave()) for joint in body.joints]
        self._centre = np.radians([wave.centre_deg for wave in waves])
        self._amplitude = np.radians([wave.amplitude_deg for wave in waves])
        self._phase = np.radians([wave.phase_deg for wave in waves])
        self._harmonics = [
            (joint, math.radians(wave.amplitude_deg), wave.order, math.radians(wave.phase_deg))
            for joint, swing in enumerate(waves)
            for wave in swing.harmonics
        ]
        self._form = gait.wave_form
        self._turn = 2 * math.pi * control_step / gait.period
        self._always = gait.when == "always"
        self._rest = body.rest
        self._steps = 0

    def act(self, observation: Mapping[str, Vector]) -> Vector:
        """Joint targets of this step."""
        if not self._always and not watched(float(observation["gaze"][0])):
            self._steps = 0
            return self._rest
        turned = self._turn * self._steps
        targets = self._centre + self._amplitude * waved(turned + self._phase, self._form)
        for joint, amplitude, order, phase in self._harmonics:
            targets[joint] += amplitude * math.sin(order * turned + phase)
        self._steps += 1
        return np.asarray(targets)


def watched(gaze: float) -> bool:
    """Whether a rig whose axis passes a teacher by this angle (rad) is watching it."""
    return abs(gaze) <= ATTENTION


_POLICIES: dict[str, Callable[[GaitSpec, Morphology, float], Policy]] = {
    "still": Still,
    "cyclic": Cyclic,
    "push": Still,  # the world does it, see events.py
}


def scripted_policy(gait: GaitSpec, body: Morphology, control_step: float) -> Policy:
    """The policy that performs a gait with this body.

    Raises:
        UserError: If the gait has yet to be drawn.
    """
    if gait.kind not in _POLICIES:
        raise UserError(
            f"the {gait.kind} gait has yet to be drawn", "use testbed.scenario.drawn(scenario, trial)"
        )
    return _POLICIES[gait.kind](gait, body, control_step)
