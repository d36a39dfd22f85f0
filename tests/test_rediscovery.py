"""After damage the student models itself anew: what broke, where a joint is stuck, and whether anything did."""

from __future__ import annotations

import math

import numpy as np
import pytest
from test_damage import NOISE
from test_settling import prior_of

from testbed.bodies.morphology import Vector
from testbed.student.body.active_discovery import ActiveDiscovery
from testbed.student.body.damage_report import DamageKind, DamageReport, suffered
from testbed.student.body.genomes import Foresight, Genomes, body_of
from testbed.student.body.posterior import SelfKnowledge
from testbed.student.body.rediscovery import Rediscovery, renewed
from testbed.student.body.self_model import Tree
from testbed.student.body.settling import Settler, tilt_of_up
from testbed.student.body.suppositions import Supposition
from testbed.student.parameters import ActiveDiscoveryParameters, RediscoveryParameters

ANGLES = np.radians([50.0, 120.0])
OWN = ActiveDiscoveryParameters()
ANEW = RediscoveryParameters(commands=5, bodies=60)


@pytest.fixture(scope="module", params=[(0, 1), (0, 0)], ids=["chain", "splayed"])
def knowledge(request: pytest.FixtureRequest) -> SelfKnowledge:
    tree: Tree = request.param
    body = Settler(body_of(prior_of(2), tree, ANGLES, np.ones(2)))
    discovery = ActiveDiscovery(prior_of(2), OWN, np.random.default_rng(0))
    rng = np.random.default_rng(1)
    while discovery.wants_more:
        command = discovery.next_command()
        discovery.tell(command, body.tilt(command[None])[0] + rng.normal(0, NOISE, 2))
    known = discovery.record()
    assert known.parents == tree
    return known


def felt(tree: Tree, kind: DamageKind, limb: int, place: float, command: Vector) -> Vector:
    """(2,) rad: what the broken body would feel, without noise."""
    whole = Genomes(np.array([tree]), np.concatenate([ANGLES, np.zeros(4)])[None])
    broken, gains = suffered(whole, kind, limb, place)
    return np.asarray(tilt_of_up(Foresight(prior_of(2)).feel(broken, command[None], gains)[0])[0])


def live(
    knowledge: SelfKnowledge,
    kind: DamageKind,
    limb: int,
    place: float = 0.0,
    *,
    believed: DamageKind = "limb_lost",
    wrongly: int = 0,
    alarm: Vector | None = None,
) -> tuple[DamageReport, Rediscovery]:
    """Something happened; the student believes something else at first, and discovers itself anew."""
    noticed = DamageReport.of(knowledge, believed, wrongly, None, 0.95, 2)
    again = Rediscovery(knowledge, noticed, ANEW, OWN, np.random.default_rng(2))
    rng = np.random.default_rng(3)
    first = np.radians([40.0, 30.0])
    again.tell(first, felt(knowledge.parents, kind, limb, place, first) if alarm is None else alarm)
    told = 0
    while again.wants_more:
        command = again.next_command()
        again.tell(command, felt(knowledge.parents, kind, limb, place, command) + rng.normal(0, NOISE, 2))
        told += 1
    assert told == ANEW.commands
    return again.record(), again


def error_deg(report: DamageReport, limb: int) -> float:
    return abs(math.degrees(float(report.itself.angles[limb] - ANGLES[limb])))


@pytest.mark.parametrize("limb", [0, 1])
def test_a_lost_limb_is_found_out_though_another_was_believed_lost(
    knowledge: SelfKnowledge, limb: int
) -> None:
    report, _ = live(knowledge, "limb_lost", limb, wrongly=1 - limb)
    assert report.limb == limb
    assert report.at_first is not None
    assert report.at_first.limb == 1 - limb
    assert report.noticed_after == 2
    for left in report.motors:
        assert report.itself.parents[left] == knowledge.parents[left]
        assert error_deg(report, left) < 3 or not report.itself.identifiable[left]
        assert any(words.startswith(f"limb_{'ab'[left]} hangs") for words in report.words)


@pytest.mark.parametrize(("limb", "place_deg"), [(0, 31.0), (1, 44.0)])
def test_a_joint_is_found_stuck_about_where_it_is(
    knowledge: SelfKnowledge, limb: int, place_deg: float
) -> None:
    report, again = live(knowledge, "joint_locked", limb, math.radians(place_deg), wrongly=1 - limb)
    assert (report.kind, report.limb) == ("joint_locked", limb)
    assert report.locked_angle is not None
    # How long the limbs are is hardly known of these bodies, and a longer limb tilts as much at a smaller angle.
    assert math.degrees(report.locked_angle) == pytest.approx(place_deg, abs=4)
    assert report.probability > 0.95
    assert np.isclose(again.shares.sum(), 1)
    assert report.motors == (0, 1)
    low, high = report.body.joints[f"joint_{'ab'[limb]}"].limits_deg
    assert low < math.degrees(report.locked_angle) < high


def test_a_false_alarm_is_withdrawn(knowledge: SelfKnowledge) -> None:
    toppled = np.radians([70.0, -20.0])
    report, _ = live(knowledge, "none", -1, believed="joint_locked", wrongly=1, alarm=toppled)
    assert (report.kind, report.limb, report.joint) == ("none", None, None)
    assert report.noticed_after == 2
    assert "as I know it" in report.words[0]
    assert report.itself.holds(knowledge.parents, ANGLES)


def test_what_tilt_does_not_tell_is_told_as_unknown(knowledge: SelfKnowledge) -> None:
    report, _ = live(knowledge, "limb_lost", 1)
    assert report.limb == 1
    assert report.probability < 0.95  # stuck off the ground it would feel the same
    assert any("what I can feel does not tell" in words for words in report.words)


def test_a_wrong_topology_is_left(knowledge: SelfKnowledge) -> None:
    """All samples hang limb b on the wrong part; what was felt, and is, says otherwise."""
    wrong = knowledge.samples.parents.copy()
    wrong[:, 1] = 1 - wrong[:, 1]
    misled = renewed(knowledge, Genomes(wrong, knowledge.samples.values), knowledge.bias, OWN)
    assert misled.parents != knowledge.parents
    rng = np.random.default_rng(5)
    one = Supposition("none", -1, 0.0, misled, 80, Foresight(prior_of(2)), rng)
    for command in np.radians([[40.0, 30.0], [0.0, 60.0], [60.0, 0.0], [50.0, 70.0]]):
        one.tell(command, felt(knowledge.parents, "none", -1, 0.0, command), 20)
    assert np.mean([tree == knowledge.parents for tree in one.bodies.trees]) > 0.9


def test_evidence_is_the_mean_likelihood_over_the_prior() -> None:
    """Stuck at any angle of the travel: letting in the first reading by degrees gives what a sum over many gives."""
    body = Settler(body_of(prior_of(1), (0,), ANGLES[:1], np.ones(1)))
    discovery = ActiveDiscovery(prior_of(1), OWN, np.random.default_rng(0))
    while discovery.wants_more:
        command = discovery.next_command()
        discovery.tell(command, body.tilt(command[None])[0])
    known = discovery.record()
    command, tilt = np.radians([30.0]), body.tilt(np.radians([[50.0]]))[0]
    few, many = (
        Supposition("joint_locked", 0, 0.0, known, count, Foresight(prior_of(1)), np.random.default_rng(1))
        for count in (200, 4000)
    )
    few.tell(command, tilt, 3)
    many.tell(command, tilt, 0)
    assert few.log_evidence == pytest.approx(many.log_evidence, abs=0.6)
    assert math.degrees(float(np.median(few.places))) == pytest.approx(50, abs=2)


def test_the_same_seed_discovers_the_same(knowledge: SelfKnowledge) -> None:
    short = RediscoveryParameters(commands=1, bodies=20)
    noticed = DamageReport.of(knowledge, "limb_lost", 0, None, 0.95, 1)
    found = []
    for _ in range(2):
        again = Rediscovery(knowledge, noticed, short, OWN, np.random.default_rng(7))
        again.tell(np.radians([40.0, 30.0]), np.radians([5.0, 5.0]))
        found.append(again.next_command())
        again.tell(found[-1], np.radians([5.0, 5.0]))
        found.append(again.record().itself.angles)
    assert np.array_equal(found[0], found[2])
    assert np.array_equal(found[1], found[3])
