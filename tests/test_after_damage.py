"""What a student does after damage, and how it is held against the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_settling import prior_of

from testbed.bodies.morphology import Morphology, load_robot
from testbed.experiment.self_report import damage_row
from testbed.experiment.trial import run_trial
from testbed.scenario import Scenario, parse_scenario
from testbed.student.body.active_discovery import ActiveDiscovery
from testbed.student.body.damage_report import DamageKind, DamageReport
from testbed.student.body.posterior import SelfKnowledge
from testbed.student.body.rediscovery import renewed
from testbed.student.body.settling import Settler
from testbed.student.parameters import ActiveDiscoveryParameters

OWN = ActiveDiscoveryParameters()


def scenario_of(damage: str) -> Scenario:
    text = f"teachers: []\nstudent: {{method: like_me, robot: crawler{damage}}}"
    return parse_scenario(text, Path("broken.yaml"))


@pytest.fixture(scope="module")
def known() -> tuple[SelfKnowledge, SelfKnowledge, Morphology]:
    """What a crawler knows, the same with all angles wrong by a tenth of a radian, and the crawler."""
    body = load_robot("crawler")
    discovery = ActiveDiscovery(prior_of(2), OWN, np.random.default_rng(0))
    while discovery.wants_more:
        command = discovery.next_command()
        discovery.tell(command, Settler(body).tilt(command[None])[0])
    knowledge = discovery.record().simplest(np.pi / 2)
    assert knowledge.angles.tolist() == [0, 0]
    samples = knowledge.samples.take(np.zeros(30, dtype=int))
    samples.values[:, :2] = 0.1
    off = renewed(knowledge, samples, knowledge.bias[:30], OWN.model_copy(update={"simplest_deg": 0.0}))
    return knowledge, off, body


def reported(
    knowledge: SelfKnowledge, kind: DamageKind, limb: int, angle: float | None, first: DamageReport | None
) -> DamageReport:
    return DamageReport.of(knowledge, kind, limb, angle, 0.9, 1, at_first=first)


def test_before_and_after_are_held_against_the_truth(
    known: tuple[SelfKnowledge, SelfKnowledge, Morphology],
) -> None:
    knowledge, off, body = known
    first = reported(off, "joint_locked", 1, 0.3, None)
    found = reported(knowledge, "joint_locked", 1, 0.5, first)
    joints = np.array([[0.0, 0.0], [0.2, 0.49]])
    row = damage_row(found, scenario_of(", damage: {joint_locked: joint_b, at: 40}"), body, joints)
    assert row["damage"] == "joint_locked limb_b"
    assert row["damage_found"] == "joint_locked limb_b"
    assert row["damage_kind_right"] is row["damage_named_right"] is row["damage_named_right_first"] is True
    assert row["left_topology_right"] is True
    assert row["left_angle_error_deg"] == pytest.approx(0)
    assert row["left_angle_error_deg_first"] == pytest.approx(np.degrees(0.1))
    assert row["locked_error_deg"] == pytest.approx(np.degrees(0.01))
    assert row["locked_error_deg_first"] == pytest.approx(np.degrees(0.19))
    assert row["alarm_withdrawn"] is False


def test_where_nothing_is_left_no_angle_is_wrong(
    known: tuple[SelfKnowledge, SelfKnowledge, Morphology],
) -> None:
    knowledge, _, body = known
    first = reported(knowledge, "joint_locked", 1, 0.3, None)
    found = reported(knowledge, "limb_lost", 0, None, first)
    row = damage_row(
        found, scenario_of(", damage: {limb_lost: limb_a, at: 40}"), body, np.full((3, 2), np.nan)
    )
    assert (row["damage_named_right"], row["damage_named_right_first"]) == (True, False)
    assert row["left_angle_error_deg"] is row["locked_error_deg"] is None
    assert found.motors == ()


def test_a_withdrawn_alarm_is_no_alarm(known: tuple[SelfKnowledge, SelfKnowledge, Morphology]) -> None:
    knowledge, _, body = known
    found = reported(knowledge, "none", -1, None, reported(knowledge, "limb_lost", 0, None, None))
    row = damage_row(found, scenario_of(""), body, np.zeros((3, 2)))
    assert row["alarm_withdrawn"] is True
    assert row["damage"] is row["damage_found"] is row["damage_noticed_after"] is None
    assert all(value is None for key, value in row.items() if key != "alarm_withdrawn")


def test_with_a_limb_lost_another_teacher_is_like_it() -> None:
    text = """
seed: 7
student: {method: like_me, robot: crawler, damage: {limb_lost: limb_b, at: 34}}
rig: {camera_rate: 5}
teachers:
  - robot: two_part
    bearing_deg: 25
    distance: 1.3
    gait: {period: 2, joints: {joint_a: {amplitude_deg: 30, centre_deg: 20}}}
"""
    result = run_trial(parse_scenario(text, Path("lost.yaml")), 0)
    itself, verdict = result.rows
    assert itself["damage_found"] == "limb_lost limb_b"
    assert (verdict["verdict"], verdict["verdict_since"]) == ("inappropriate", "appropriate")
    assert verdict["chosen"] is True
    assert int(result.arrays["perform/steps"]) > 0
    assert "I have lost limb_b" in str(result.arrays["self/words_since"][0])
