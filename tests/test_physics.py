"""The simulation: repeatable bit for bit, servos that are finite, tilt that has the right sign."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from testbed.bodies.morphology import load_robot
from testbed.physics import PhysicsSpec, Simulation, tilt_of


def trajectory(simulation: Simulation, targets: np.ndarray) -> bytes:
    states = []
    for target in targets:
        simulation.command("robot", target)
        simulation.step(4)
        states.append(np.concatenate([simulation.base("robot"), simulation.joints("robot")]))
    return np.array(states).tobytes()


TARGETS = np.random.default_rng(0).uniform(-1.5, 1.5, (12, 2)).repeat(15, axis=0)


def test_a_reset_repeats_the_motion_bit_for_bit() -> None:
    with Simulation() as simulation:
        simulation.add("robot", load_robot("crawler"))
        first = trajectory(simulation, TARGETS)
        simulation.command("robot", np.array([1.0, 1.0]))
        simulation.step(37)  # leave in the middle of a contact
        simulation.reset("robot")
        assert trajectory(simulation, TARGETS) == first


def test_a_reset_forgets_every_contact() -> None:
    """Bullet would start from old contact points where the body happens to lie nearly as it did before."""
    crawler, short = load_robot("crawler"), TARGETS[:20]
    with Simulation() as simulation:
        simulation.add("robot", crawler, place=(0.3, -0.2), yaw=0.4)
        first = trajectory(simulation, short)
        for seed in range(150):
            rng = np.random.default_rng(seed)
            simulation.reset("robot")
            for _ in range(rng.integers(1, 120)):
                simulation.command("robot", rng.uniform(*crawler.limits.T))
                simulation.step(4)
            simulation.reset("robot")
            assert trajectory(simulation, short) == first, seed


def test_other_bodies_before_and_beside_change_nothing() -> None:
    """A search adds and removes many bodies; what one does must not depend on which came before."""
    with Simulation() as simulation:
        simulation.add("robot", load_robot("crawler"))
        first = trajectory(simulation, TARGETS)
    with Simulation() as simulation:
        for _ in range(3):
            simulation.add("other", load_robot("splayed"))
            simulation.command("other", np.array([1.0, -1.0]))
            simulation.step(50)
            simulation.remove("other")
        simulation.add("robot", load_robot("crawler"))
        assert trajectory(simulation, TARGETS) == first


def test_servos_have_finite_speed_and_torque() -> None:
    crawler = load_robot("crawler")
    with Simulation(PhysicsSpec(gravity=0.0)) as simulation:
        simulation.add("robot", crawler)
        simulation.command("robot", np.array([math.pi / 2, 0.0]))
        simulation.step(24)  # 0.1 s
        reached = simulation.joints("robot")[0]
        assert 0.5 * math.radians(30) < reached <= math.radians(31)  # 300 deg/s
    weak = crawler.varied(joints={"joint_a": {"torque": 0.001}})
    with Simulation() as simulation:
        simulation.add("robot", weak)
        simulation.command("robot", np.array([-math.pi / 2, 0.0]))
        simulation.step(240)
        assert simulation.joints("robot")[0] > math.radians(-45)  # cannot lift 80 g at arm's length


def test_pushing_down_in_front_lifts_the_nose() -> None:
    with Simulation() as simulation:
        simulation.add("robot", load_robot("crawler"))
        simulation.command("robot", np.radians([60.0, 0.0]))
        simulation.step(360)
        side, nose_down = simulation.tilt("robot")
        assert nose_down < math.radians(-10)
        assert abs(side) < math.radians(2)


@pytest.mark.parametrize("angle", [-2.5, -0.3, 0.0, 0.4, 1.2])
def test_tilt_reads_rotations_about_either_axis(angle: float) -> None:
    assert tilt_of(Rotation.from_euler("x", angle).as_quat()) == pytest.approx([angle, 0.0], abs=1e-12)
    if abs(angle) < math.pi / 2:
        assert tilt_of(Rotation.from_euler("y", angle).as_quat()) == pytest.approx([0.0, angle], abs=1e-12)


def test_heading_does_not_show_in_the_tilt() -> None:
    tilted = Rotation.from_euler("xy", [0.2, -0.4])
    turned = Rotation.from_euler("z", 1.3) * tilted
    assert tilt_of(turned.as_quat()) == pytest.approx(tilt_of(tilted.as_quat()))


def test_a_seized_joint_holds_what_its_servo_could_not() -> None:
    weak = load_robot("crawler").varied(joints={"joint_a": {"torque": 0.01}})

    def sag(*, locked: bool) -> float:
        with Simulation() as simulation:
            simulation.add("robot", weak)
            base = simulation.base("robot")
            simulation.pose("robot", base, np.array([-0.8, 0.0]))
            if locked:
                simulation.lock("robot", "joint_a")
            simulation.command("robot", np.array([-0.8, 0.0]))
            simulation.step(120)
            return abs(float(simulation.joints("robot")[0]) + 0.8)

    assert sag(locked=False) > 0.3
    assert sag(locked=True) < 0.02


def test_a_body_of_another_shape_takes_the_place_and_posture_of_the_one_before() -> None:
    with Simulation() as simulation:
        simulation.add("robot", load_robot("crawler"), place=(0.3, -0.2), yaw=0.7)
        simulation.command("robot", np.array([0.4, -0.3]))
        simulation.step(240)
        base, joints = simulation.base("robot"), simulation.joints("robot")
        simulation.replace("robot", load_robot("crawler").without("limb_b"))
        assert simulation.base("robot") == pytest.approx(base)
        assert simulation.joints("robot") == pytest.approx(joints[:1])
        simulation.reset("robot")
        assert simulation.base("robot")[:2] == pytest.approx((0.3, -0.2))
        assert 2 * math.atan2(*simulation.base("robot")[5:7]) == pytest.approx(0.7)


def test_a_pushed_ball_rolls_without_slipping() -> None:
    with Simulation() as simulation:
        simulation.add("ball", load_robot("ball"))
        simulation.push("ball", (0.3, -0.1))
        simulation.step(240)
        assert simulation.base("ball")[:2] == pytest.approx(
            (0.3, -0.1), rel=0.06
        )  # Bullet slows it down a little
        assert simulation.speed("ball") == pytest.approx(0.3 / 0.07, rel=0.1)
