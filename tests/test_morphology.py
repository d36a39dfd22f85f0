"""Bodies: mass properties against trimesh, kinematics against Bullet, and every way to get a tree wrong."""

from __future__ import annotations

import math

import numpy as np
import pybullet
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from testbed.bodies.morphology import CappedCylinder, Cuboid, Morphology, Sphere, load_robot
from testbed.bodies.urdf import to_urdf
from testbed.errors import UserError
from testbed.physics import Simulation
from testbed.resources import robot_names

lengths = st.floats(0.005, 0.5)


def mesh_of(part: Cuboid | Sphere | CappedCylinder) -> trimesh.Trimesh:
    if isinstance(part, Cuboid):
        mesh = trimesh.creation.box(extents=part.size)
    elif isinstance(part, Sphere):
        mesh = trimesh.creation.icosphere(subdivisions=5, radius=part.radius)
    else:
        mesh = trimesh.creation.capsule(height=part.length, radius=part.radius)
        mesh.apply_transform(trimesh.transformations.rotation_matrix(math.pi / 2, [0, 1, 0]))
        mesh.apply_translation(-mesh.center_mass)
    mesh.density = part.density
    return mesh


parts = st.one_of(
    st.builds(Cuboid, size=st.tuples(lengths, lengths, lengths), density=st.floats(100, 5000)),
    st.builds(Sphere, radius=lengths, density=st.floats(100, 5000)),
    st.builds(CappedCylinder, radius=lengths, length=lengths, density=st.floats(100, 5000)),
)


@settings(max_examples=40, deadline=None)
@given(parts)
def test_mass_properties_agree_with_trimesh(part: Cuboid | Sphere | CappedCylinder) -> None:
    mesh = mesh_of(part)
    assert part.mass == pytest.approx(mesh.mass, rel=5e-3)
    assert part.inertia == pytest.approx(np.diag(mesh.moment_inertia), rel=1e-2)


def test_the_crawler_has_the_papers_parts() -> None:
    crawler = load_robot("crawler")
    body, *limbs = crawler.parts.values()
    assert isinstance(body, Cuboid)
    assert body.size == (0.14, 0.11, 0.05)
    assert [(limb.radius, limb.length) for limb in limbs if isinstance(limb, CappedCylinder)] == [
        (0.01, 0.20)
    ] * 2
    assert body.mass == pytest.approx(0.14 * 0.11 * 0.05 * 600)
    assert all(part.density == 600 for part in crawler.parts.values())
    assert np.degrees(crawler.limits).tolist() == [[-90, 90], [-90, 90]]


def test_zero_lies_flat_and_positive_is_downward() -> None:
    crawler = load_robot("crawler")
    flat = crawler.poses([0, 0])
    assert [round(pose[2, 3], 12) for pose in flat.values()] == [0, 0, 0]
    assert flat["limb_b"][0, 3] == pytest.approx(0.07 + 0.20 + 0.10)
    down = crawler.poses([math.radians(30), 0])
    assert down["limb_a"][2, 3] == pytest.approx(-0.10 * math.sin(math.radians(30)))
    assert crawler.poses([-0.5, 0])["limb_a"][2, 3] > 0


def test_splayed_carries_a_limb_on_either_side() -> None:
    poses = load_robot("splayed").poses([0, 0])
    assert poses["limb_a"][0, 3] == pytest.approx(0.17)
    assert poses["limb_b"][0, 3] == pytest.approx(-0.17)


@pytest.mark.parametrize("name", robot_names())
@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
def test_every_robot_loads_in_bullet_with_the_same_body(name: str, scale: float) -> None:
    """Masses, inertias and forward kinematics of the URDF as Bullet reads it are those of the description."""
    body = load_robot(name).scaled(scale)
    rng = np.random.default_rng(3)
    with Simulation() as simulation:
        simulation.add("robot", body)
        number = simulation._bodies["robot"].number
        for link, part in enumerate(simulation._bodies["robot"].parts, start=-1):
            mass, friction, inertia = pybullet.getDynamicsInfo(
                number, link, physicsClientId=simulation.client
            )[:3]
            assert mass == pytest.approx(body.parts[part].mass)
            assert friction == pytest.approx(body.parts[part].friction)
            assert inertia == pytest.approx(tuple(body.parts[part].inertia), rel=1e-6)
        for _ in range(5):
            angles = rng.uniform(*body.limits.T)
            simulation.pose("robot", np.array([0.1, -0.2, 1.0, 0, 0, 0, 1]), angles)
            poses = body.poses(angles)
            for link, part in enumerate(simulation._bodies["robot"].parts[1:]):
                state = pybullet.getLinkState(
                    number, link, computeForwardKinematics=True, physicsClientId=simulation.client
                )
                assert np.array(state[0]) - (0.1, -0.2, 1.0) == pytest.approx(poses[part][:3, 3], abs=1e-6)


def test_urdf_carries_the_servos() -> None:
    urdf = to_urdf(load_robot("crawler"))
    assert 'effort="1.2"' in urdf
    assert f'velocity="{math.radians(300):.9g}"' in urdf


@given(st.floats(0.3, 3.0))
def test_scaling_keeps_density_and_multiplies_lengths(factor: float) -> None:
    crawler = load_robot("crawler")
    scaled = crawler.scaled(factor)
    assert scaled.mass == pytest.approx(crawler.mass * factor**3)
    for name, pose in scaled.poses([0.4, -0.7]).items():
        assert pose[:3, 3] == pytest.approx(crawler.poses([0.4, -0.7])[name][:3, 3] * factor)


def test_variation_changes_what_is_named_and_nothing_else() -> None:
    crawler = load_robot("crawler")
    varied = crawler.varied(
        parts={"limb_b": {"length": 0.1, "luminosity": 20}},
        joints={"joint_b": {"angle_deg": 30, "along": 0.5}},
    )
    assert varied.parts["limb_a"] == crawler.parts["limb_a"]
    limb = varied.parts["limb_b"]
    assert isinstance(limb, CappedCylinder)
    assert (limb.length, limb.luminosity) == (0.1, 20)
    assert varied.mount(varied.joints["joint_b"])[0, 3] == pytest.approx(0.0)
    with pytest.raises(KeyError):
        crawler.varied(parts={"tail": {"length": 0.1}})


def test_a_limb_mounts_where_a_ray_from_the_centre_leaves_the_box() -> None:
    for angle in range(0, 360, 15):
        body = load_robot("crawler").varied(joints={"joint_a": {"angle_deg": angle}})
        x, y, z = body.mount(body.joints["joint_a"])[:3, 3]
        assert math.isclose(max(abs(x) / 0.07, abs(y) / 0.055), 1.0)
        assert math.atan2(y, x) % math.tau == pytest.approx(math.radians(angle) % math.tau)
        assert z == 0


def chain(limbs: int) -> dict[str, object]:
    parts = {"body": {"shape": "cuboid", "size": [0.1, 0.1, 0.05]}}
    joints = {}
    previous = "body"
    for limb in range(limbs):
        name = f"limb_{limb}"
        parts[name] = {"shape": "capped_cylinder", "radius": 0.01, "length": 0.1}
        joints[f"joint_{limb}"] = {"parent": previous, "child": name}
        previous = name
    return {"name": "chain", "parts": parts, "joints": joints}


@pytest.mark.parametrize("limbs", [0, 1, 4, 8])
def test_any_number_of_limbs(limbs: int) -> None:
    body = Morphology.model_validate(chain(limbs))
    assert len(body.poses(np.zeros(limbs))) == limbs + 1
    with Simulation() as simulation:
        simulation.add("chain", body)
        simulation.step(10)
        assert np.isfinite(simulation.base("chain")).all()


@pytest.mark.parametrize(
    ("joints", "complaint"),
    [
        ({"j": {"parent": "body", "child": "nowhere"}}, "refers to no part: 'nowhere'"),
        (
            {"j": {"parent": "body", "child": "limb_0"}, "k": {"parent": "body", "child": "limb_0"}},
            "hangs on two",
        ),
        ({"j": {"parent": "body", "child": "limb_0"}, "k": {"parent": "limb_0", "child": "body"}}, "ring"),
        ({}, "not joined"),
    ],
)
def test_what_is_no_tree_is_refused(joints: dict[str, object], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        Morphology.model_validate(chain(1) | {"joints": joints})


def test_a_robot_file_with_a_mistake_names_the_line(tmp_path) -> None:
    file = tmp_path / "broken.yaml"
    file.write_text(
        "name: broken\nparts:\n  body: {shape: cuboid, size: [0.1, 0.1, 0.1]}\n"
        "joints:\n  j: {parent: body, child: leg}\n"
    )
    with pytest.raises(UserError) as error:
        load_robot(file)
    assert "broken.yaml:" in str(error.value)
    assert "refers to no part: 'leg'" in str(error.value)
    with pytest.raises(UserError, match="crawler"):
        load_robot("crawlr")


def test_what_falls_off_takes_along_what_hangs_on_it() -> None:
    tree = load_robot("four_tree")
    assert list(tree.without("limb_a").parts) == ["body", "limb_c"]
    assert list(tree.without("limb_a").joints) == ["joint_c"]
    assert list(tree.without("limb_b").parts) == ["body", "limb_a", "limb_c"]
    for nobody in ("body", "limb_x"):
        with pytest.raises(KeyError):
            tree.without(nobody)


@given(st.floats(0.5, 2.0))
def test_stretching_changes_the_length_of_limbs_alone(factor: float) -> None:
    crawler = load_robot("crawler")
    for name, part in crawler.stretched(factor).parts.items():
        times = 1 if name == "body" else factor
        assert part.length_along_x == pytest.approx(crawler.parts[name].length_along_x * times)
        assert part.density == crawler.parts[name].density
    one = crawler.stretched([1, factor, 3])
    assert one.parts["limb_a"] == crawler.parts["limb_a"]
    assert one.parts["limb_b"].length_along_x == pytest.approx(0.2 * factor)
    box = Cuboid(size=(0.1, 0.2, 0.3)).stretched(factor)
    assert box.size == pytest.approx((0.1 * factor, 0.2, 0.3))
    assert Sphere(radius=0.1).stretched(factor).radius == pytest.approx(0.1 * factor)


def test_rest_is_as_flat_as_the_joints_allow() -> None:
    assert load_robot("quadruped").rest.tolist() == [0.0] * 8
    assert np.degrees(load_robot("locked").rest) == pytest.approx([0, 29.5])
    lowered = load_robot("crawler").varied(joints={"joint_a": {"limits_deg": (-60, -10)}})
    assert np.degrees(lowered.rest) == pytest.approx([-10, 0])
    assert load_robot("locked").resting_height() > 0.1 * math.sin(math.radians(29.5))


def test_a_robots_file_is_read_anew_when_it_was_changed(tmp_path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("name: mine\nparts:\n  body: {shape: sphere, radius: 0.1}\n")
    assert load_robot(file) == load_robot(file)
    file.write_text("name: mine\nparts:\n  body: {shape: sphere, radius: 0.125}\n")
    body = load_robot(file).parts["body"]
    assert isinstance(body, Sphere)
    assert body.radius == 0.125
