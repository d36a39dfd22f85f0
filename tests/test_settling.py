"""The settle solver: closed forms, the physical simulation, and motions that go on from where they were."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from testbed.bodies.morphology import CappedCylinder, Cuboid, Joint, Morphology, Sphere, Vector, load_robot
from testbed.physics import Simulation, tilt_of
from testbed.student.body._candidates import settle_candidates
from testbed.student.body.commands import CommandParameters
from testbed.student.body.genomes import Foresight, Genomes, body_of, random_tree
from testbed.student.body.imagination import Imagination
from testbed.student.body.plausibility import Felt
from testbed.student.body.self_model import BodyPrior
from testbed.student.body.servos import Servos
from testbed.student.body.settling import Settler, parents_first, tilt_of_up, up_of_tilt
from testbed.student.moving.rolls import headings
from testbed.student.parameters import ImaginationParameters, PlausibilityParameters

MAIN, LIMB = (
    Cuboid(size=(0.14, 0.11, 0.05), friction=0.25),
    CappedCylinder(radius=0.01, length=0.2, friction=0.9),
)


def prior_of(limbs: int) -> BodyPrior:
    motors = tuple(Joint(parent="main", child=f"limb_{'abcdefgh'[i]}") for i in range(limbs))
    return BodyPrior(main=MAIN, limbs=(LIMB,) * limbs, motors=motors)


def random_body(rng: np.random.Generator, limbs: int) -> Morphology:
    return body_of(
        prior_of(limbs), random_tree(limbs, rng), rng.uniform(-math.pi, math.pi, limbs), np.ones(limbs)
    )


def test_a_limb_pushing_down_lifts_the_box_about_its_rear_edge() -> None:
    """Closed form: edge at (-w, -h), cap centre at (w, 0) + L (cos q, -sin q), whose lowest point is r below."""
    body = Morphology(
        name="one", parts={"main": MAIN, "limb": LIMB}, joints={"j": Joint(parent="main", child="limb")}
    )
    for command in np.radians([25.0, 45.0, 70.0, 85.0]):
        x, z = 0.14 + 0.2 * math.cos(command), 0.025 - 0.2 * math.sin(command)  # cap seen from the edge
        # Turned nose-up by t about the edge, the cap's height is x sin t + z cos t; it rests at the radius.
        expected = math.asin(0.01 / math.hypot(x, z)) - math.atan2(z, x)
        side, nose_down = Settler(body).tilt(np.array([[command]]))[0]
        assert side == pytest.approx(0.0, abs=1e-9)
        assert nose_down == pytest.approx(-expected, abs=1e-7)


def test_a_flat_body_lies_as_its_description_says() -> None:
    for name in ("crawler", "splayed"):
        body = load_robot(name)
        (base,) = Settler(body).settle(np.zeros((1, 2)))
        assert base == pytest.approx([0, 0, body.resting_height(), 0, 0, 0, 1], abs=1e-9)


def test_a_ball_and_an_overhanging_limb() -> None:
    ball = Morphology(name="ball", parts={"ball": Sphere(radius=0.07)})
    (base,) = Settler(ball).settle(np.zeros((1, 0)))
    assert base[2] == pytest.approx(0.07)
    heavy = CappedCylinder(radius=0.01, length=0.2, density=30_000)
    body = Morphology(
        name="heavy", parts={"main": MAIN, "limb": heavy}, joints={"j": Joint(parent="main", child="limb")}
    )
    tilt = Settler(body).tilt(np.zeros((1, 1)))[0]  # topples over the front edge until the limb's end touches
    expected = math.atan2(0.025, 0.2) - math.asin(0.01 / math.hypot(0.2, 0.025))
    assert tilt == pytest.approx([0.0, expected], abs=1e-7)


@pytest.mark.parametrize("limbs", [2, 3])
def test_it_agrees_with_the_physical_simulation(limbs: int) -> None:
    """Over 600 postures of 60 bodies: median 0.03 deg, 97% within 1 deg; the rest topples with a swing."""
    rng = np.random.default_rng(7)
    apart = []
    with Imagination(ImaginationParameters(), 1 / 60) as imagination:
        for _ in range(12):
            body, commands = random_body(rng, limbs), rng.uniform(-math.pi / 2, math.pi / 2, (8, limbs))
            simulated = imagination.settle(body, commands, limit=1.5, rest_speed=0.02)
            cosines = np.sum(up_of_tilt(Settler(body).tilt(commands)) * up_of_tilt(simulated), axis=1)
            apart.append(np.degrees(np.arccos(np.clip(cosines, -1, 1))))
    assert np.median(apart) < 0.1
    assert np.mean(np.concatenate(apart) < 5) >= (0.93 if limbs == 2 else 0.88)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 5))
def test_the_centre_of_mass_is_supported_and_nothing_is_under_the_ground(seed: int, limbs: int) -> None:
    rng = np.random.default_rng(seed)
    body, commands = random_body(rng, limbs), rng.uniform(-1.5, 1.5, (3, limbs))
    for base, command in zip(Settler(body).settle(commands), commands, strict=True):
        turn, points, masses, centres = Rotation.from_quat(base[3:]), [], [], []
        for name, pose in body.poses(command).items():
            part = body.parts[name]
            masses.append(part.mass)
            centres.append(pose[:3, 3])
            if isinstance(part, Cuboid):
                corners = (
                    np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
                    * np.array(part.size)
                    / 2
                )
                points += [(pose[:3, :3] @ corner + pose[:3, 3], 0.0) for corner in corners]
            else:
                ends = (-0.5, 0.5)
                points += [(pose[:3, 3] + pose[:3, 0] * part.length_along_x * e, part.radius) for e in ends]
        places = turn.apply([point for point, _ in points]) + base[:3]
        heights = places[:, 2] - [radius for _, radius in points]
        assert heights.min() == pytest.approx(0.0, abs=1e-6)
        mass = turn.apply(np.average(centres, axis=0, weights=masses)) + base[:3]
        feet = places[heights < 2e-6, :2] - mass[:2]
        # In no direction do all feet lie on one side of the centre of mass.
        ways = np.array([[math.cos(t), math.sin(t)] for t in np.linspace(0, math.tau, 720)])
        assert (feet @ ways.T).max(axis=0).min() > -1e-4


def test_a_motion_goes_on_from_where_the_body_lies() -> None:
    crawler = load_robot("crawler")
    steps = np.radians(np.stack([np.linspace(0, 70, 40), np.linspace(0, 30, 40)], axis=1))
    bases, joints = Settler(crawler).follow(steps)
    assert bases.shape == (40, 7)
    assert np.array_equal(joints, steps)
    assert tilt_of(bases[-1, 3:]) == pytest.approx(Settler(crawler).tilt(steps[-1:])[0], abs=1e-6)
    rolls = headings(crawler, bases, joints)
    assert np.allclose(np.linalg.norm(rolls, axis=2), 1)
    assert np.abs(np.diff(bases, axis=0)).max() < 0.1  # no leaps
    toppled = np.array([[0.0, 0.0], [math.radians(-80), 0.0], [0.0, 0.0]])
    assert Settler(crawler).follow(toppled)[0].shape == (3, 7)


def test_servos_take_the_time_that_they_take_in_the_simulation() -> None:
    """Over 16 gaits: median .003 deg, and 1.04 if servos are taken to arrive at once."""
    crawler, servos = load_robot("crawler"), Servos(1 / 60)
    times = np.arange(150)[:, None] / 60
    gait = np.radians([20.0, 55.0]) + np.radians([33.0, 20.0]) * np.sin(
        math.pi * times + np.array([0.0, 2.0])
    )
    with Imagination(ImaginationParameters(), 1 / 60) as mind, mind.imagine(crawler) as rehearsal:
        simulated, turned = rehearsal.move(gait)
        assert rehearsal.servos == servos
    bases, joints = Settler(crawler).follow(gait, servos)
    assert np.degrees(np.median(np.abs(joints - turned))) < 0.02
    assert (
        np.degrees(np.abs(joints - turned).max()) < 3
    )  # to the first posture at full speed, limbs have weight
    apart = (Rotation.from_quat(simulated[:, 3:]).inv() * Rotation.from_quat(bases[:, 3:])).magnitude()
    assert np.degrees(np.median(apart)) < 0.1
    assert np.mean(np.degrees(apart) < 5) > 0.95


def test_a_servo_turns_no_faster_than_it_can_and_arrives() -> None:
    reached = Servos(1 / 60).angles(np.full((60, 2), [1.0, -1.0]), np.zeros(2), np.array([3.0, 600.0]))
    assert reached[:9, 0] == pytest.approx(np.arange(1, 10) * 3 / 60)
    assert reached[0, 1] == pytest.approx(0.9**4 - 1)
    assert reached[-1] == pytest.approx([1.0, -1.0], abs=0.01)
    assert np.abs(reached).max() <= 1


def test_tilt_and_up_are_inverse() -> None:
    tilt = np.random.default_rng(0).uniform(-1.4, 1.4, (50, 2))
    assert tilt_of_up(up_of_tilt(tilt)) == pytest.approx(tilt)


def test_joints_may_be_described_in_any_order() -> None:
    assert parents_first(np.array([2, 0])).tolist() == [1, 0]
    with pytest.raises(ValueError, match="no tree"):
        parents_first(np.array([2, 1]))
    body = random_body(np.random.default_rng(3), 3)
    turned = Morphology(name="turned", parts=body.parts, joints=dict(reversed(body.joints.items())))
    commands = np.random.default_rng(1).uniform(-1, 1, (5, 3))
    assert Settler(turned).tilt(commands[:, ::-1]) == pytest.approx(Settler(body).tilt(commands), abs=1e-9)


@pytest.mark.parametrize("limbs", [1, 2, 4])
def test_many_bodies_at_once_are_each_settled_alike(limbs: int) -> None:
    rng, prior = np.random.default_rng(limbs), prior_of(limbs)
    trees = np.array([random_tree(limbs, rng) for _ in range(6)])
    values = np.concatenate(
        [rng.uniform(-3, 3, (6, limbs)), rng.normal(0, 0.05, (6, limbs)), rng.normal(0, 0.1, (6, limbs))],
        axis=1,
    )
    genomes, commands = Genomes(trees, values), rng.uniform(-1.2, 1.2, (4, limbs))
    mind = Foresight(prior)
    ups = mind.feel(genomes, commands)
    assert mind.evaluations == 6
    for tree, angles, offsets, stretches, up in zip(
        genomes.trees, genomes.angles, genomes.offsets, genomes.stretches, ups, strict=True
    ):
        alone = Settler(body_of(prior, tree, angles, stretches)).tilt(commands + offsets)
        assert tilt_of_up(up) == pytest.approx(alone, abs=1e-7)


def test_a_lost_limb_and_a_locked_joint() -> None:
    prior, commands = prior_of(2), np.radians([[60.0, 20.0], [30.0, 70.0]])
    both = Genomes(np.array([[0, 1], [0, 1]]), np.zeros((2, 6)))
    both.values[0, 5] = -np.inf  # limb b is gone
    both.values[1, 3] = 0.4  # joint b is stuck
    ups: Vector = Foresight(prior).feel(both, commands, np.array([[1.0, 1.0], [1.0, 0.0]]))
    one = Morphology(
        name="one", parts={"main": MAIN, "limb": LIMB}, joints={"j": Joint(parent="main", child="limb")}
    )
    assert tilt_of_up(ups[0]) == pytest.approx(Settler(one).tilt(commands[:, :1]), abs=1e-9)
    stuck = commands.copy()
    stuck[:, 1] = 0.4
    whole = Settler(body_of(prior, (0, 1), np.zeros(2), np.ones(2)))
    assert tilt_of_up(ups[1]) == pytest.approx(whole.tilt(stuck), abs=1e-7)


def test_what_lies_well_stays_and_what_does_not_rolls_to_where_it_does() -> None:
    rng, prior = np.random.default_rng(2), prior_of(3)
    tree, angles = random_tree(3, rng), rng.uniform(-3, 3, 3)
    body, commands = Settler(body_of(prior, tree, angles, np.ones(3))), rng.uniform(-1.2, 1.2, (8, 3))
    resting = up_of_tilt(body.tilt(commands))
    assert body.stays(commands, resting) == pytest.approx(resting, abs=1e-6)
    somewhere = rng.normal(size=(8, 3))
    rolled = body.stays(commands, somewhere / np.linalg.norm(somewhere, axis=1, keepdims=True))
    assert body.stays(commands, rolled) == pytest.approx(rolled, abs=1e-6)
    assert np.abs(rolled - resting).max() > 0.1
    on_its_back = np.tile([0.0, 0.0, -1.0], (8, 1))
    assert body.stays(0 * commands, on_its_back) == pytest.approx(on_its_back)

    genomes = Genomes(np.array([tree]), np.concatenate([angles, np.zeros(6)])[None])
    ups, _ = Foresight(prior).foresee(genomes, commands, starts=rolled, there=True)
    assert ups[0] == pytest.approx(rolled, abs=1e-6)
    ups, _ = Foresight(prior).foresee(genomes, -commands, starts=on_its_back[0])
    assert (ups[0, :, 2] < 0).mean() > 0.5
    Foresight(prior).foresee(genomes, commands[:1])  # one level start, which NumPy makes without a copy
    Foresight(prior).foresee(genomes, commands, starts=np.asfortranarray(rolled))
    assert len(settle_candidates.signatures) == 1  # type: ignore[attr-defined]  # however arrays came: compiled once


def test_a_body_is_recognised_by_how_it_lies_even_if_it_was_thrown_there_or_is_on_its_back() -> None:
    """Four parts in Bullet, never put down anew: what comes of a swift motion from anywhere."""
    tree, angles, rng = (0, 1, 0), np.radians([-112.4, -1.9, 57.9]), np.random.default_rng(0)
    commands = CommandParameters(lift_share=0.6).draw(np.radians([[-90.0, 90.0]] * 3), 12, rng)
    with Simulation() as simulation:
        simulation.add("self", body_of(prior_of(3), tree, angles, np.ones(3)))
        felt = Felt(commands, np.array([_lying_and_moving(simulation, command) for command in commands]))
    me = Genomes(np.array([tree]), np.concatenate([angles, np.zeros(6)])[None])
    mind = Foresight(prior_of(3))
    off = {
        in_place: np.linalg.norm(
            mind.relive(me, felt, PlausibilityParameters(in_place=in_place))[0] - felt.up, axis=1
        )
        for in_place in (False, True)
    }
    assert (off[False] > math.radians(10)).sum() > 3
    assert off[True].max() < math.radians(1.5)


def _lying_and_moving(simulation: Simulation, command: Vector) -> Vector:
    for target in (0 * command, command):
        simulation.command("self", target)
        simulation.step(720)
    return simulation.tilt("self")
