"""Active self-discovery: the right body from few commands, what is known and what is not, and honest counting."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_settling import prior_of

from testbed.bodies.morphology import Morphology, Vector
from testbed.physics import Simulation
from testbed.student.body.active_discovery import ActiveDiscovery
from testbed.student.body.commands import CommandParameters, worth_of
from testbed.student.body.genomes import Genomes, all_trees, body_of, is_tree, random_tree
from testbed.student.body.plausibility import Felt, judge_bodies
from testbed.student.body.population import survivors, tempered
from testbed.student.body.posterior import FoldClass, SelfKnowledge, fold_classes
from testbed.student.body.proposals import Proposals, pointing
from testbed.student.body.self_model import Tree
from testbed.student.body.settling import Settler, up_of_tilt
from testbed.student.parameters import ActiveDiscoveryParameters, PlausibilityParameters

NOISE = math.radians(0.5)


def discover(
    tree: Tree, angles: Vector, seed: int, *, bullet: bool = False, **changes: object
) -> tuple[SelfKnowledge, ActiveDiscovery]:
    """A student with this body finds itself; its world is Bullet, or the settle solver."""
    prior, rng = prior_of(len(tree)), np.random.default_rng([seed, 1])
    body = body_of(prior, tree, angles, np.ones(len(tree)))
    discovery = ActiveDiscovery(
        prior, ActiveDiscoveryParameters().model_copy(update=changes), np.random.default_rng(seed)
    )
    with Simulation() as simulation:
        simulation.add("self", body)
        while discovery.wants_more:
            command = discovery.next_command()
            felt = _in_bullet(simulation, command) if bullet else Settler(body).tilt(command[None])[0]
            discovery.tell(command, felt + rng.normal(0, NOISE, 2))
    return discovery.record(), discovery


def _in_bullet(simulation: Simulation, command: Vector) -> Vector:
    simulation.reset("self")
    simulation.command("self", command)
    simulation.step(360)
    return simulation.tilt("self")


def off_by(one: Vector, other: Vector) -> float:
    """Largest angle between, deg."""
    return float(np.degrees(np.abs(np.angle(np.exp(1j * (one - other)))).max()))


@pytest.mark.parametrize("seed", range(4))
def test_it_finds_random_bodies_in_the_simulated_world(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tree, angles = (0, int(rng.integers(2))), rng.uniform(-math.pi, math.pi, 2)
    knowledge, discovery = discover(tree, angles, seed, bullet=True)
    assert knowledge.parents == tree
    assert knowledge.commands.shape == (10, 2)
    assert knowledge.evaluations == discovery.mind.evaluations <= 2000
    if all(knowledge.identifiable):
        assert off_by(knowledge.angles, angles) < 8
    assert any(one.parents == tree and off_by(one.angles, angles) < 25 for one in knowledge.fold_classes), (
        knowledge.words()
    )


def test_the_paper_s_own_body_lies_in_a_blind_spot_and_is_taken_for_its_middle() -> None:
    """Nothing that it can feel tells 10 from -10 deg: limb a is close to the normal of the front face."""
    angles = np.radians([10.0, -20.0])
    knowledge, _ = discover((0, 1), angles, 3)
    assert knowledge.parents == (0, 1)
    assert knowledge.identifiable == (False, False)
    assert off_by(knowledge.angles, np.zeros(2)) < 35
    assert knowledge.holds((0, 1), angles)
    assert knowledge.holds((0, 1), -angles)
    assert not knowledge.holds((0, 0), angles)
    assert not knowledge.holds((0, 1), angles + 1.5)
    assert knowledge.words()[1].startswith("limb_b hangs on limb_a (100%)")


def test_mirror_images_are_both_held_and_said() -> None:
    angles = np.radians([-60.0, 179.0])
    knowledge, _ = discover((0, 1), angles, 3)
    assert knowledge.parents == (0, 1)
    assert not knowledge.identifiable[0]
    assert knowledge.holds((0, 1), angles)
    assert knowledge.holds((0, 1), np.radians([-120.0, -179.0]))
    spread = np.radians([2.0, 3.0])
    images = (
        FoldClass((0, 1), np.radians([-60.0, 179.0]), spread, 0.6),
        FoldClass((0, 1), np.radians([-120.0, -179.0]), spread, 0.4),
    )
    assert (
        "mirror images about the normal of the right face"
        in replace(knowledge, fold_classes=images).words()[-1]
    )


def test_offsets_and_lengths_are_fitted_too() -> None:
    """A body whose servos are off by 4 and -4 deg; whoever ignores that gets its angles wrong by more."""
    prior, rng = prior_of(2), np.random.default_rng(5)
    angles, offsets = np.radians([75.0, -140.0]), np.radians([4.0, -4.0])
    body = Settler(body_of(prior, (0, 0), angles, np.array([1.05, 0.95])))
    parameters = ActiveDiscoveryParameters(commands=16, evaluations=2500)
    discovery = ActiveDiscovery(prior, parameters, np.random.default_rng(0))
    while discovery.wants_more:
        command = discovery.next_command()
        discovery.tell(command, body.tilt((command + offsets)[None])[0] + rng.normal(0, NOISE, 2))
    knowledge = discovery.record()
    assert knowledge.parents == (0, 0)
    assert off_by(knowledge.angles, angles) < 5
    assert np.degrees(np.abs(knowledge.offsets - offsets)).max() < 3
    assert knowledge.history[-1].evaluations <= knowledge.evaluations <= 2500
    assert math.degrees(knowledge.history[-1].error) < 2


def test_the_same_seed_finds_the_same() -> None:
    first, _ = discover((0, 1), np.array([1.0, 2.0]), 9, commands=3, evaluations=400)
    again, _ = discover((0, 1), np.array([1.0, 2.0]), 9, commands=3, evaluations=400)
    assert np.array_equal(first.commands, again.commands)
    assert np.array_equal(first.samples.values, again.samples.values)
    assert first.evaluations <= 550  # keeping a population up to date has its price


def test_one_limb_and_four() -> None:
    for limbs in (1, 4):
        tree = tuple(range(limbs))
        knowledge, _ = discover(tree, np.full(limbs, 0.9), limbs, commands=2, evaluations=400)
        assert len(knowledge.body.parts) == limbs + 1
        assert len(knowledge.words()) >= limbs


# The parts of it.


def test_all_trees_are_trees_and_no_other_is() -> None:
    assert [len(all_trees(n)) for n in (1, 2, 3, 4)] == [1, 3, 16, 125]  # Cayley: (n + 1)^(n - 1)
    assert not is_tree((1,))
    assert not is_tree((2, 1))
    assert is_tree((2, 0))
    assert all(is_tree(random_tree(8, np.random.default_rng(seed))) for seed in range(20))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 6), st.booleans())
def test_proposals_are_bodies(seed: int, limbs: int, outward: bool) -> None:
    rng = np.random.default_rng(seed)
    proposals = Proposals(limbs, PlausibilityParameters(), rng, outward=outward, elite=10.0)
    people = proposals.from_prior(12)
    children = proposals.from_people(people, rng.normal(size=12), 20)
    assert len(children) == 20
    assert all(is_tree(tree) for tree in [*people.trees, *children.trees])
    if outward:
        assert all(parent <= limb for tree in children.trees for limb, parent in enumerate(tree))
    assert np.abs(children.angles).max() <= math.pi + 1e-9
    assert np.isfinite(children.values).all()


def test_a_limb_is_hung_everywhere_that_it_may() -> None:
    proposals = Proposals(3, PlausibilityParameters(), np.random.default_rng(0), outward=True, elite=10.0)
    person = Genomes(np.array([[0, 1, 2]]), np.array([[0.3, -0.4, 0.5, 0, 0, 0, 0, 0, 0]]))
    found = proposals.everywhere(person, 1)
    assert len(found) == 16  # eight directions on the main body, and on limb a
    assert set(found.trees) == {(0, 0, 2), (0, 1, 2)}
    for tree, value in zip(found.parents, found.values, strict=True):
        end = pointing(tree, value, 3)
        assert math.remainder(end - 0.4, math.tau) == pytest.approx(0, abs=1e-9)


def test_the_simplest_body_is_taken_only_where_it_is_plausible() -> None:
    right, slanted = (discover((0, 1), np.radians(angles), 3)[0] for angles in ((0.0, 0.0), (-60.0, 130.0)))
    assert np.degrees(right.simplest(math.pi / 2).angles) == pytest.approx([0.0, 0.0])
    assert right.simplest(0.0) is right
    kept = slanted.simplest(math.pi / 2)
    assert kept.angles == pytest.approx(slanted.angles)
    assert kept.stages[-1][1] == pytest.approx(kept.angles)
    assert len(kept.stages) == len(kept.errors) == len(kept.commands) + 1
    assert kept.errors[-1] < math.radians(3)


@pytest.mark.parametrize("limbs", [1, 2, 3, 8])
def test_the_defaults_fit_the_body(limbs: int) -> None:
    parameters = ActiveDiscoveryParameters.for_limbs(limbs)
    assert parameters.commands >= 10
    assert parameters.evaluations >= 2000
    tree = random_tree(limbs, np.random.default_rng(limbs), outward=True)
    hurried = {**parameters.model_dump(), "commands": 2, "evaluations": 700}
    discovery = ActiveDiscovery(
        prior_of(limbs), ActiveDiscoveryParameters.model_validate(hurried), np.random.default_rng(0)
    )
    body = Settler(body_of(prior_of(limbs), tree, np.full(limbs, 0.7), np.ones(limbs)))
    while discovery.wants_more:
        command = discovery.next_command()
        discovery.tell(command, body.tilt(command[None])[0])
    assert len(discovery.record().history) == 2


def test_a_limb_hung_elsewhere_may_go_on_pointing_where_it_did() -> None:
    assert pointing(np.array([0, 1]), np.radians([30.0, 40.0]), 2) == pytest.approx(math.radians(70))
    assert pointing(np.array([0, 0]), np.radians([30.0, 40.0]), 2) == pytest.approx(math.radians(40))


def test_plausibility_is_highest_for_what_was_felt_and_forgives_a_bias_and_an_outlier() -> None:
    beliefs = PlausibilityParameters()
    tilt = np.random.default_rng(0).uniform(-0.8, 0.8, (8, 2))
    felt = Felt(np.zeros((8, 2)), tilt)
    values = np.zeros((4, 6))
    ups = np.stack(
        [up_of_tilt(tilt), up_of_tilt(tilt - [0.017, -0.017]), up_of_tilt(tilt), up_of_tilt(tilt + 0.2)]
    )
    ups[2, 3] = up_of_tilt(np.array([[1.2, -1.2]]))
    fit = judge_bodies(ups, values, felt, beliefs)
    perfect, biased, outlier, wrong = fit.log_posterior
    assert perfect > biased > wrong
    assert perfect > outlier > wrong
    assert np.degrees(fit.bias[1]) == pytest.approx([1, -1], abs=0.2)
    assert fit.weights[2, 3] < 0.01 * fit.weights[2, 0]
    pulled = judge_bodies(ups[:1], np.array([[0, 0, 0.1, 0, 0, 0.1]]), felt, beliefs)
    assert pulled.log_posterior[0] < perfect


def test_the_effect_of_a_bias_is_the_derivative() -> None:
    tilt = np.random.default_rng(1).uniform(-1.3, 1.3, (6, 2))
    felt = Felt(np.zeros((6, 2)), tilt)
    for axis in (0, 1):
        step = np.eye(2)[axis] * 1e-6
        slope = (up_of_tilt(tilt + step) - up_of_tilt(tilt - step)) / 2e-6
        assert felt.bias_effect[:, :, axis] == pytest.approx(slope, abs=1e-8)


def test_the_command_about_which_opinions_differ_is_worth_most() -> None:
    ups = up_of_tilt(np.array([[0.0, 0.0], [0.0, 0.3], [0.0, 0.0], [0.0, -0.3]])).reshape(2, 2, 3)
    worth = worth_of(np.full(2, 0.5), ups, np.ones((2, 2)), NOISE, CommandParameters())
    assert worth[1] > 10 * max(worth[0], 1e-9)
    hasty = worth_of(np.full(2, 0.5), ups, np.full((2, 2), 4.0), NOISE, CommandParameters())
    assert hasty[1] < 0.1 * worth[1]


def test_commands_keep_within_the_travel() -> None:
    prior, rng = prior_of(3), np.random.default_rng(0)
    commands = CommandParameters().draw(prior.limits, 200, rng)
    near = CommandParameters().near(commands, prior.limits, rng)
    assert np.degrees(np.abs(np.concatenate([commands, near]))).max() <= 84 + 1e-9
    assert (commands != 0).any(axis=1).all()
    assert (commands > 0).sum() > (commands < 0).sum()
    assert np.array_equal(near == 0, commands == 0)
    alone = CommandParameters().draw(prior.limits, 50, rng, alone=1)
    assert (alone[:, 1] > 0).all()
    assert (alone[:, [0, 2]] <= 0).all()  # flat, or lifted out of the way


def test_every_topology_keeps_its_place_and_twins_do_not() -> None:
    people = Genomes(np.array([[0, 0], [0, 0], [0, 0], [0, 1]]), np.zeros((4, 6)))
    people.values[:, 0] = [0.0, 0.01, 1.0, 0.0]
    parameters = ActiveDiscoveryParameters(population=4, per_tree=1)
    assert survivors(people, np.array([3.0, 2.0, 1.0, -50.0]), parameters) == [0, 2, 3]


def test_votes_are_tempered() -> None:
    weights = tempered(np.array([0.0, -100.0, -200.0, -300.0]), 2.0)
    assert weights.sum() == pytest.approx(1)
    assert 1 / np.sum(weights**2) >= 2
    assert (np.diff(weights) < 0).all()


def test_samples_that_lie_together_are_one_class() -> None:
    angles = np.radians([[10, 5], [12, 5], [14, 6], [-12, -5], [179, 0], [-179, 0]])
    samples = Genomes(
        np.array([[0, 1]] * 4 + [[0, 0]] * 2), np.concatenate([angles, np.zeros((6, 4))], axis=1)
    )
    classes = fold_classes(samples, np.array([0.2, 0.2, 0.1, 0.3, 0.1, 0.1]), width=math.radians(8))
    assert [round(one.probability, 6) for one in classes] == [0.5, 0.3, 0.2]
    assert classes[2].parents == (0, 0)
    assert abs(math.degrees(classes[2].angles[0])) == pytest.approx(180)


def test_a_body_keeps_the_names_and_order_of_its_motors() -> None:
    body = body_of(prior_of(2), (2, 0), np.radians([10.0, 400.0]), np.array([1.0, 1.1]))
    assert isinstance(body, Morphology)
    assert [joint.child for joint in body.joints.values()] == ["limb_a", "limb_b"]
    assert body.joints["joint_a"].parent == "limb_b"
    assert body.joints["joint_b"].angle_deg == pytest.approx(40)
    assert body.parts["limb_b"].length_along_x == pytest.approx(0.22)
