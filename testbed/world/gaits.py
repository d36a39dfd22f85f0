"""How teachers move: scripted policies that act through the same ``step`` as everybody else.

A new behaviour is a class with ``act`` and one line in ``_POLICIES``; a new gait of a known kind is one line in
``PRESETS`` or a block in a scenario file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np

from testbed.morphology import Morphology, Vector
from testbed.scenario import GaitSpec, JointWave

ATTENTION = math.radians(10)
"""A rig whose axis passes a teacher by less than this is watching it (rad); well under half the field of view, so
that two teachers who do not share a view are never both watched."""

PRESETS: dict[str, GaitSpec] = {
    "still": GaitSpec(kind="still"),
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
        self._rest = np.zeros(len(body.joints))

    def act(self, observation: Mapping[str, Vector]) -> Vector:
        """Zeros."""
        return self._rest


class Cyclic:
    """Every joint follows a sine: centre + amplitude sin(2 pi t / period + phase), t since the gait began.

    A gait that waits to be watched starts afresh whenever the student's rig turns to the teacher, and lies flat
    while it looks elsewhere: a teacher that crawled all the time would be out of sight before the student is done
    discovering itself.
    """

    def __init__(self, gait: GaitSpec, body: Morphology, control_step: float) -> None:
        waves = [gait.joints.get(joint, JointWave()) for joint in body.joints]
        self._centre = np.radians([wave.centre_deg for wave in waves])
        self._amplitude = np.radians([wave.amplitude_deg for wave in waves])
        self._phase = np.radians([wave.phase_deg for wave in waves])
        self._turn = 2 * math.pi * control_step / gait.period
        self._always = gait.when == "always"
        self._steps = 0

    def act(self, observation: Mapping[str, Vector]) -> Vector:
        """Joint targets of this step."""
        if not self._always and abs(float(observation["gaze"][0])) > ATTENTION:
            self._steps = 0
            return np.zeros_like(self._centre)
        targets = self._centre + self._amplitude * np.sin(self._turn * self._steps + self._phase)
        self._steps += 1
        return np.asarray(targets)


_POLICIES: dict[str, Callable[[GaitSpec, Morphology, float], Policy]] = {"still": Still, "cyclic": Cyclic}


def scripted_policy(gait: GaitSpec, body: Morphology, control_step: float) -> Policy:
    """The policy that performs a gait with this body."""
    return _POLICIES[gait.kind](gait, body, control_step)
