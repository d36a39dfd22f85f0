"""Robots from elsewhere: URDF files with their meshes become bodies, are seen, kept with the run, and get a verdict."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pybullet_data
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from testbed.bodies.meshes import load_mesh
from testbed.bodies.morphology import Mesh, Morphology, load_robot
from testbed.bodies.robot_files import content_of, copies_of
from testbed.bodies.urdf_bodies import link_shape
from testbed.errors import UserError
from testbed.experiment import runner
from testbed.experiment.run_directory import RunDirectory
from testbed.experiment.trial import run_trial
from testbed.experiment.truth import is_like, parts_in_view
from testbed.physics import Simulation
from testbed.report.page import write_report
from testbed.report.pictures import robot_picture
from testbed.scenario import Scenario, check, content_hash, load_scenario, parse_scenario, with_overrides
from testbed.world.bullet import SimulatedBackend

DATA = Path(pybullet_data.getDataPath())
SHIPPED = {
    "r2d2": DATA / "r2d2.urdf",
    "kuka": DATA / "kuka_iiwa" / "model.urdf",
    "racecar": DATA / "racecar" / "racecar.urdf",
}
PARTS = {"r2d2": (8, 7), "kuka": (8, 7), "racecar": (7, 6)}


@pytest.fixture(scope="module", params=SHIPPED)
def robot(request: pytest.FixtureRequest) -> tuple[str, Morphology]:
    return request.param, load_robot(SHIPPED[request.param])


def test_links_become_parts_and_turning_joints_hinges(robot: tuple[str, Morphology]) -> None:
    name, body = robot
    assert (len(body.parts), len(body.joints)) == PARTS[name]
    assert all(isinstance(part, Mesh) for part in body.parts.values())
    assert 1 < body.mass < 100
    assert body.model_validate(body.model_dump()) == body


def test_sizes_masses_and_moments_scale(robot: tuple[str, Morphology]) -> None:
    body, half = robot[1], robot[1].scaled(0.5)
    assert half.mass == pytest.approx(body.mass / 8)
    np.testing.assert_allclose(half.reach(), np.array(body.reach()) / 2)
    for part, smaller in zip(body.parts.values(), half.parts.values(), strict=True):
        assert isinstance(smaller, Mesh)
        np.testing.assert_allclose(smaller.inertia, part.inertia / 32)
        np.testing.assert_allclose(smaller.size, np.array(part.size) / 2)


def test_bullet_has_every_part_where_the_morphology_has_it(robot: tuple[str, Morphology]) -> None:
    """Forward kinematics against Bullet's, in a posture that the body reached under gravity."""
    import pybullet

    body = robot[1].scaled(0.3)
    rng = np.random.default_rng(4)
    with Simulation() as simulation:
        simulation.add("it", body)
        low, high = body.limits.T
        simulation.command("it", np.clip(rng.uniform(-0.6, 0.6, len(low)), low, high))
        simulation.step(60)
        base, poses = simulation.base("it"), body.poses(simulation.joints("it"))
        root = np.eye(4)
        root[:3, :3], root[:3, 3] = Rotation.from_quat(base[3:]).as_matrix(), base[:3]
        known = simulation._bodies["it"]
        for link, name in enumerate(known.parts[1:]):
            state = pybullet.getLinkState(
                known.number, link, computeForwardKinematics=1, physicsClientId=simulation.client
            )
            pose = root @ poses[name]
            np.testing.assert_allclose(state[4], pose[:3, 3], atol=1e-5)
            np.testing.assert_allclose(Rotation.from_quat(state[5]).as_matrix(), pose[:3, :3], atol=1e-4)
        dynamics = pybullet.getDynamicsInfo(known.number, -1, physicsClientId=simulation.client)
        assert dynamics[0] == pytest.approx(body.parts[body.root].mass, rel=1e-5)


def test_it_stands_on_the_ground_and_stays_there(robot: tuple[str, Morphology]) -> None:
    body = robot[1].scaled(0.3)
    with Simulation() as simulation:
        simulation.add("it", body)
        before = simulation.base("it")
        simulation.step(48)
        assert np.abs(simulation.base("it")[:3] - before[:3]).max() < 0.02


def test_shown_where_it_is_and_as_large(robot: tuple[str, Morphology]) -> None:
    """The silhouette in the world's picture against the outline of the part's own corners."""
    name = robot[0]
    teacher = f"{{robot: {SHIPPED[name]}, scale: 0.3, gait: still, luminosity: 90}}"
    text = f"rig: {{camera_noise: 0}}\nteachers:\n  - {teacher}\n"
    scenario = parse_scenario(text)
    backend = SimulatedBackend(scenario)
    rows, columns = np.nonzero(backend.look()[0] < 200)
    base, joints = backend.state("teacher_0")
    body = backend.robots["teacher_0"]
    root = np.eye(4)
    root[:3, :3], root[:3, 3] = Rotation.from_quat(base[3:]).as_matrix(), base[:3]
    placed = [root @ pose for pose in body.poses(joints).values()]
    corners = np.concatenate(
        [
            part.points @ pose[:3, :3].T + pose[:3, 3]
            for part, pose in zip(body.parts.values(), placed, strict=True)
            if isinstance(part, Mesh)
        ]
    )
    rig = scenario.rig
    focal = 50 / np.tan(np.radians(rig.field_of_view_deg) / 2)
    u = 50 + focal * (corners[:, 0] + rig.baseline / 2) / corners[:, 1]
    v = 37.5 + focal * (rig.height - corners[:, 2]) / corners[:, 1]
    assert columns.min() == pytest.approx(u.min(), abs=2)
    assert columns.max() + 1 == pytest.approx(u.max(), abs=2)
    assert rows.min() == pytest.approx(v.min(), abs=2)
    assert rows.max() + 1 == pytest.approx(v.max(), abs=2)
    described = parts_in_view(body, base, joints, eye_height=rig.height, pan=0.0)
    assert described.shape == (len(body.parts), 8)
    assert np.isfinite(described).all()
    backend.close()


def test_only_its_like_is_like_it(robot: tuple[str, Morphology]) -> None:
    body = robot[1]
    assert is_like(body, body.scaled(0.4))
    assert not is_like(load_robot("crawler"), body)
    others = [load_robot(path) for name, path in SHIPPED.items() if name != robot[0]]
    assert not any(is_like(body, other) for other in others)


def test_a_picture_of_it(robot: tuple[str, Morphology], tmp_path: Path) -> None:
    assert robot_picture(robot[1], tmp_path / "it.png").stat().st_size > 20_000


def test_only_what_is_far_from_convex_is_taken_apart() -> None:
    """A ring becomes several convex pieces with a hole in the middle; a ball stays one."""
    path = DATA / "kuka_iiwa" / "model.urdf"
    assert len(link_shape(path, "lbr_iiwa_link_0").hulls) == 1
    ring = trimesh.creation.annulus(0.08, 0.1, 0.02)
    from testbed.bodies.meshes import _convex

    pieces = _convex(ring, whole=False)
    assert len(pieces) >= 4
    assert sum(piece.volume for piece in pieces) < 1.6 * ring.volume
    assert not any(piece.contains([[0.0, 0.0, 0.0]])[0] for piece in pieces)
    assert len(_convex(trimesh.creation.icosphere(), whole=False)) == 1


URDF = """<?xml version="1.0"?>
<robot name="two">
  <material name="dark"><color rgba="0.2 0.2 0.2 1"/></material>
  <link name="base"><visual><geometry><box size="0.2 0.1 0.05"/></geometry><material name="dark"/></visual></link>
  <link name="plate"><visual><geometry><box size="0.02 0.02 0.1"/></geometry></visual></link>
  <joint name="weld" type="fixed"><parent link="base"/><child link="plate"/><origin xyz="0 0 0.07"/></joint>
  <link name="arm">
    <inertial><mass value="0.5"/></inertial>
    <visual><origin xyz="0.1 0 0"/><geometry><mesh filename="arm.stl"/></geometry></visual>
  </link>
  <joint name="elbow" type="revolute">
    <parent link="base"/><child link="arm"/><origin xyz="0.1 0 0" rpy="0 0 0.5"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="2" velocity="3"/>
  </joint>
</robot>
"""


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    trimesh.creation.box((0.2, 0.02, 0.02)).export(tmp_path / "arm.stl")
    (tmp_path / "two.urdf").write_text(URDF)
    return tmp_path / "two.urdf"


def test_what_a_urdf_says(urdf: Path) -> None:
    body = load_robot(urdf)
    assert list(body.parts) == ["base", "arm"]
    assert body.parts["base"].luminosity == pytest.approx((51 + 110) / 2, abs=1)
    assert body.parts["arm"].mass == pytest.approx(0.5)
    joint = body.joints["elbow"]
    assert joint.limits == pytest.approx((-1, 1))
    assert (joint.torque, joint.speed_deg) == pytest.approx((2, np.degrees(3)))
    flat, turned = (body.poses([angle])["arm"] for angle in (0.0, 0.5))
    base, arm = body.parts["base"], body.parts["arm"]
    assert isinstance(base, Mesh)
    assert isinstance(arm, Mesh)
    volumes = np.array([0.2 * 0.1 * 0.05, 0.02 * 0.02 * 0.1])
    height = volumes @ [0, 0.07] / volumes.sum()  # of the centre of mass above the base's own middle
    np.testing.assert_allclose(flat[:3, 3], [0.1, 0, -height], atol=1e-6)
    np.testing.assert_allclose(flat[:3, 0], [np.cos(0.5), np.sin(0.5), 0], atol=1e-6)
    assert turned[2, 0] == pytest.approx(-np.sin(0.5))  # positive is downward
    assert arm.size == pytest.approx((0.2, 0.02, 0.02), abs=1e-6)
    np.testing.assert_allclose(arm.inertia[1], 0.5 / 12 * (0.2**2 + 0.02**2), rtol=1e-3)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "<robot ",
            '<!DOCTYPE robot [<!ENTITY a "aaaa">]><robot ',
            "two.urdf:2: document types are not read",
        ),
        ("</robot>", "", "no well-formed XML"),
        ("arm.stl", "leg.stl", "two.urdf:9: mesh 'leg.stl' is not there"),
        ("arm.stl", "../../../../../../etc/passwd", "meshes are not read"),
        (
            'value="0.5"',
            'value="x"',
            "two.urdf:8: 'value' of <mass> must be 1 finite number; write 1, not 'x'",
        ),
        ('value="0.5"', 'value="${m}"', "two.urdf:8: this is xacro and not yet URDF; expand it"),
        ('<link name="arm">', '<xacro:arm/><link name="arm">', "two.urdf:7: this is xacro"),
        ('<child link="arm"/>', '<child link="leg"/>', "the joint's child 'leg' is no link"),
        ('type="revolute"', 'type="elastic"', "there are no elastic joints"),
        ('<parent link="base"/><child link="arm"/>', '<parent link="arm"/><child link="arm"/>', "ring"),
        ("<robot ", "<model ", "no well-formed XML"),
    ],
)
def test_mistakes_in_urdf_files(urdf: Path, old: str, new: str, said: str) -> None:
    urdf.write_text(URDF.replace(old, new, 1))
    with pytest.raises(UserError) as caught:
        load_robot(urdf)
    assert said in str(caught.value)


def test_a_xacro_file_is_told_how_to_become_urdf(urdf: Path) -> None:
    named = urdf.with_suffix(".xacro")
    named.write_text(URDF.replace('value="0.5"', 'value="${m}"', 1))
    with pytest.raises(UserError, match=r"two.xacro:8: this is xacro and not yet URDF; expand it"):
        load_robot(str(named))


def test_a_mesh_that_is_none(urdf: Path) -> None:
    (urdf.parent / "arm.stl").write_bytes(b"no mesh at all")
    with pytest.raises(UserError, match=r"arm.stl.*mesh"):
        load_robot(urdf)


def test_blank_lines_before_and_zeros_behind_do_no_harm(urdf: Path) -> None:
    parts = load_robot(urdf).parts
    urdf.write_bytes(b"\n\n" + urdf.read_bytes() + b"\n\0")
    assert load_robot(urdf).parts == parts
    urdf.write_bytes(b"\n\n" + URDF.replace('value="0.5"', 'value="x"').encode())
    with pytest.raises(UserError, match="urdf:10: 'value'"):
        load_robot(urdf)


def test_a_robot_with_collada_meshes_is_kept_with_the_run(urdf: Path) -> None:
    load_mesh(urdf.parent / "arm.stl").export(urdf.parent / "arm.dae")
    before = load_robot(urdf)
    urdf.write_text(URDF.replace("arm.stl", "arm.dae"))
    np.testing.assert_allclose(load_robot(urdf).reach(), before.reach(), atol=1e-6)
    assert any(name.endswith(".dae") for name in copies_of(urdf))


def test_mirrored_meshes_are_not_inside_out(urdf: Path) -> None:
    urdf.write_text(URDF.replace('filename="arm.stl"', 'filename="arm.stl" scale="1 -1 1"'))
    load_robot(urdf)
    assert link_shape(urdf, "arm").seen.volume == pytest.approx(load_mesh(urdf.parent / "arm.stl").volume)


def test_copies_say_the_same_wherever_they_are(urdf: Path, tmp_path: Path) -> None:
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    for name, contents in copies_of(urdf).items():
        (folder / name).write_bytes(contents)
    assert content_of(folder / "two.urdf") == content_of(urdf)
    moved, here = load_robot(folder / "two.urdf"), load_robot(urdf)
    assert moved.mass == pytest.approx(here.mass)
    trimesh.creation.box((0.3, 0.02, 0.02)).export(folder / next(file.name for file in folder.glob("*.stl")))
    assert content_of(folder / "two.urdf") != content_of(urdf)


def test_run_directories_keep_urdf_meshes_and_recordings(urdf: Path, tmp_path: Path) -> None:
    (urdf.parent / "wave.csv").write_text("time,elbow_deg\n0,0\n1,10\n2,0\n")
    scenario_file = urdf.parent / "it.yaml"
    scenario_file.write_text(
        "teachers:\n  - {robot: two.urdf, gait: {kind: replay, file: wave.csv}, distance: 1.2}\n"
    )
    scenario = load_scenario(scenario_file)
    check(scenario)
    with RunDirectory.prepare(tmp_path / "run", scenario, dict) as run:
        said = run.hash8
    assert said == content_hash(scenario)
    moved = tmp_path / "moved"
    shutil.move(tmp_path / "run", moved)
    for file in (urdf, urdf.parent / "arm.stl", urdf.parent / "wave.csv"):
        file.unlink()
    kept = RunDirectory.open(moved).scenario
    check(kept)
    assert content_hash(kept) == said
    assert len(kept.teachers[0].body().parts) == 2


def test_a_student_is_no_mesh(urdf: Path) -> None:
    with pytest.raises(UserError, match="made of meshes"):
        check(parse_scenario(f"student: {{robot: {urdf}}}\nteachers: []\n"))
    with pytest.raises(UserError, match="cannot be made longer"):
        check(parse_scenario(f"teachers:\n  - {{robot: {urdf}, limb_scale: 1.2, gait: still}}\n"))


@pytest.fixture
def elsewhere(tmp_path: Path) -> Scenario:
    text = "name: elsewhere\nrig: {supersample: 1, camera_rate: 5}\nstudent: paper\nteachers:\n" + "".join(
        f"  - {{robot: {path}, scale: {scale}, gait: {gait}, distance: 1.3, bearing_deg: {bearing}, luminosity: 100}}\n"
        for path, scale, gait, bearing in (
            (SHIPPED["r2d2"], 0.25, "random", -55),
            (SHIPPED["kuka"], 0.2, "random", 0),
            (SHIPPED["racecar"], 0.6, "still", 55),
        )
    )
    (tmp_path / "elsewhere.yaml").write_text(text)
    scenario = with_overrides(load_scenario(tmp_path / "elsewhere.yaml"), smoke=True)
    check(scenario)
    return scenario


def test_three_robots_from_elsewhere_get_a_verdict(elsewhere: Scenario) -> None:
    """A whole life, cut down to seconds: each is found and judged, and is inappropriate in truth."""
    rows = [row for row in run_trial(elsewhere, 0).rows if row["kind"] == "verdict"]
    assert [row["truth"] for row in rows] == ["inappropriate"] * 3
    assert all(row["found"] and row["verdict"] in ("appropriate", "inappropriate") for row in rows)


@pytest.mark.slow
def test_they_are_in_the_report(elsewhere: Scenario, tmp_path: Path) -> None:
    runner.run(elsewhere, out=tmp_path / "run", workers=1)
    assert write_report(tmp_path / "run").stat().st_size > 50_000
