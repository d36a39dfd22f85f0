"""The analytic renderer against two witnesses that share nothing with it: TinyRenderer, and a mesh ray caster."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pybullet_data
import pytest
import trimesh
from numpy.typing import NDArray
from scipy import stats
from scipy.spatial.transform import Rotation

import testbed
from testbed.bodies.morphology import Morphology, load_robot
from testbed.bodies.parts import CappedCylinder, Cuboid
from testbed.errors import UserError
from testbed.physics import Simulation
from testbed.scenario import RigSpec, Scenario, check, load_scenario
from testbed.scenario.specs import LightSpec
from testbed.scenario.student import DamageSpec
from testbed.vision.noise import QuickNoise
from testbed.world.analytic import AnalyticRenderer, solids_of
from testbed.world.bullet import IMAGE, SimulatedBackend, eyes
from testbed.world.optics import projection_matrix, view_matrix

RIG = RigSpec(renderer="analytic")
ROBOTS = ("crawler", "splayed", "quadruped", "tripod", "boxes", "ball")
FLAT = LightSpec(ambient=1, diffuse=0, specular=0)


@pytest.fixture
def simulation() -> Iterator[Simulation]:
    with Simulation() as simulation:
        yield simulation


def put(simulation: Simulation, name: str, body: Morphology, rng: np.random.Generator) -> None:
    """In any place in view, any posture, and any direction, as a body that is toppling has."""
    distance, bearing = rng.uniform(0.7, 1.8), rng.uniform(-0.3, 0.3)
    simulation.add(name, body)
    place = distance * math.sin(bearing), distance * math.cos(bearing), rng.uniform(0.05, 0.2)
    turn = Rotation.random(rng=rng).as_quat() if rng.random() < 0.5 else Rotation.identity().as_quat()
    simulation.pose(name, np.array([*place, *turn]), rng.uniform(*body.limits.T))


def scene(simulation: Simulation, rng: np.random.Generator, count: int = 2) -> None:
    for index in range(count):
        put(simulation, f"robot_{index}", load_robot(ROBOTS[rng.integers(len(ROBOTS))]), rng)


def by_bullet(simulation: Simulation, rig: RigSpec, eye: NDArray[np.float64]) -> NDArray[np.float64]:
    """TinyRenderer's grey levels with a negative background, moved back by the half pixel that it is off."""
    rows, columns = IMAGE[0] * rig.supersample, IMAGE[1] * rig.supersample
    projection = list(projection_matrix(math.radians(rig.field_of_view_deg), columns, rows))
    projection[8], projection[9] = 1 / columns, 1 / rows
    light = rig.light
    colours, seen = simulation.picture(
        view_matrix(eye, eye + np.array([0.0, 1.0, 0.0])),
        tuple(projection),
        width=columns,
        height=rows,
        light={
            "lightDirection": light.direction,
            "lightAmbientCoeff": light.ambient,
            "lightDiffuseCoeff": light.diffuse,
            "lightSpecularCoeff": light.specular,
            "shadow": 0,
        },
    )
    return np.where(seen, colours[..., 0].astype(float), -1.0)


def analytic(simulation: Simulation, rig: RigSpec, eye: NDArray[np.float64]) -> NDArray[np.float64]:
    renderer = AnalyticRenderer(simulation, rig.model_copy(update={"background": -1}), IMAGE)
    return next(renderer.pictures(eye[None], 0.0)).astype(float)


@pytest.mark.parametrize("seed", range(6))
def test_agrees_with_tinyrenderer_on_random_scenes(simulation: Simulation, seed: int) -> None:
    scene(simulation, np.random.default_rng(seed))
    eye = eyes(RIG, 0.0)[0]
    theirs, ours = by_bullet(simulation, RIG, eye), analytic(simulation, RIG, eye)
    both, either = (theirs >= 0) & (ours >= 0), (theirs >= 0) | (ours >= 0)
    assert either.sum() > 300
    assert both.sum() / either.sum() > 0.93  # limbs are four pixels thick, and Bullet's caps are too short
    grey = [np.where(image < 0, 255, image) for image in (theirs, ours)]
    assert np.abs(grey[0] - grey[1]).mean() < 2.5


@pytest.mark.parametrize("seed", range(4))
def test_flat_faces_have_tinyrenderers_grey_level_exactly(simulation: Simulation, seed: int) -> None:
    rng = np.random.default_rng(seed)
    put(simulation, "robot", load_robot("boxes"), rng)
    light = LightSpec(direction=tuple(rng.normal(size=3)), ambient=0.3, diffuse=0.5, specular=0.4)
    rig, eye = RIG.model_copy(update={"light": light}), eyes(RIG, 0.0)[1]
    theirs, ours = by_bullet(simulation, rig, eye), analytic(simulation, rig, eye)
    both, either = (theirs >= 0) & (ours >= 0), (theirs >= 0) | (ours >= 0)
    assert both.sum() / either.sum() > 0.97
    differences = np.abs(theirs - ours)[both]
    assert np.quantile(differences, 0.9) <= 1.0  # the rest lies along the edges between faces


def meshes(simulation: Simulation, name: str) -> list[trimesh.Trimesh]:
    """Every part where the morphology's own kinematics puts it."""
    body, base = simulation.bodies[name], simulation.base(name)
    root = np.eye(4)
    root[:3, :3], root[:3, 3] = Rotation.from_quat(base[3:]).as_matrix(), base[:3]
    found = []
    for part, pose in body.poses(simulation.joints(name)).items():
        spec = body.parts[part]
        if isinstance(spec, Cuboid):
            mesh = trimesh.creation.box(extents=spec.size)
        elif isinstance(spec, CappedCylinder):
            mesh = trimesh.creation.capsule(height=spec.length / spec.radius, radius=1.0, count=[32, 32])
            mesh.apply_scale(spec.radius)
            mesh.apply_transform(trimesh.transformations.rotation_matrix(math.pi / 2, [0, 1, 0]))
        else:
            mesh = trimesh.creation.icosphere(subdivisions=4, radius=spec.radius)
        found.append(mesh.apply_transform(root @ pose))
    return found


@pytest.mark.parametrize("seed", range(4))
def test_who_is_seen_where_is_what_a_mesh_ray_caster_finds(simulation: Simulation, seed: int) -> None:
    """Every part has a grey level of its own, and rays tell which one is nearest: shapes and who hides whom."""
    rng = np.random.default_rng(100 + seed)
    level, solids = 0, []
    for index in range(3):
        body = load_robot(ROBOTS[rng.integers(len(ROBOTS))])
        levels = {part: {"luminosity": 10 + 8 * (level + i)} for i, part in enumerate(body.parts)}
        level += len(body.parts)
        put(simulation, f"robot_{index}", body.varied(parts=levels), rng)
        solids += meshes(simulation, f"robot_{index}")
    rig = RIG.model_copy(update={"light": FLAT, "supersample": 1})
    eye, pan = np.array([0.02, -0.1, 0.16]), 0.1
    renderer = AnalyticRenderer(simulation, rig, IMAGE)
    ours = next(renderer.pictures(eye[None], pan))

    rows, columns = IMAGE
    focal = columns / 2 / math.tan(math.radians(rig.field_of_view_deg) / 2)
    across, down = np.meshgrid(np.arange(columns) + 0.5 - columns / 2, np.arange(rows) + 0.5 - rows / 2)
    rays = np.stack([across / focal, np.ones_like(across), -down / focal], axis=-1).reshape(-1, 3)
    rays = rays @ Rotation.from_euler("z", -pan).as_matrix().T
    owner = np.repeat(np.arange(len(solids)), [len(mesh.faces) for mesh in solids])
    faces = trimesh.util.concatenate(solids).ray.intersects_first(np.tile(eye, (len(rays), 1)), rays)
    theirs = np.where(faces < 0, rig.background, 10 + 8 * owner[faces]).reshape(rows, columns)
    assert len(np.unique(theirs)) > 4
    assert np.mean(ours != theirs) < 0.005  # meshes lie a little inside of what is round


@pytest.mark.parametrize("shape", ["ball", "boxes", "crawler"])
def test_the_nearer_hides_the_farther_whoever_came_first(shape: str) -> None:
    """Two of a kind behind one another, and a little apart: the order in which they are drawn must not matter."""
    near = load_robot(shape)
    far = near.varied(parts={part: {"luminosity": 200} for part in near.parts})
    pictures = []
    for first in (0, 1):
        with Simulation() as simulation:
            for body, distance in [(near, 0.9), (far, 1.3)][:: 1 if first else -1]:
                simulation.add(f"at {distance}", body)
                place = -0.3 * (distance - 0.9), distance, 0.15
                simulation.pose(f"at {distance}", np.array([*place, 0, 0, 0, 1.0]), body.rest - 0.4)
            rig = RIG.model_copy(update={"light": FLAT})
            pictures.append(
                next(AnalyticRenderer(simulation, rig, IMAGE).pictures(np.array([[0, 0, 0.15]]), 0)).copy()
            )
    assert np.array_equal(*pictures)
    assert {110, 200, 255} == set(np.unique(pictures[0]))


def test_a_body_behind_the_cameras_or_around_them_is_not_seen(simulation: Simulation) -> None:
    simulation.add("behind", load_robot("crawler"), place=(0.0, -0.6))
    simulation.add("around", load_robot("ball"))
    simulation.pose("around", np.array([0.0, 0.0, 0.15, 0, 0, 0, 1.0]), np.zeros(0))
    picture = next(AnalyticRenderer(simulation, RIG, IMAGE).pictures(np.array([[0, 0, 0.15]]), 0.0))
    assert (picture == 255).all()


def test_a_capped_cylinder_seen_end_on_is_a_disc(simulation: Simulation) -> None:
    """Where rays run along the axis the cylinder's own equation says nothing."""
    rod = Morphology(name="rod", parts={"rod": CappedCylinder(radius=0.05, length=0.4)})
    simulation.add("rod", rod)
    along = Rotation.from_euler("z", math.pi / 2).as_quat()
    simulation.pose("rod", np.array([0.0, 1.25, 0.15, *along]), np.zeros(0))
    seen = next(AnalyticRenderer(simulation, RIG, IMAGE).pictures(np.array([[0, 0, 0.15]]), 0.0)) < 255
    # Its near ball is 1.05 m away and hides all else.
    radius = 100 / math.tan(math.radians(25)) * 0.05 / math.sqrt(1.05**2 - 0.05**2)
    assert seen.sum() == pytest.approx(math.pi * radius**2, rel=0.02)
    assert np.array_equal(seen, seen[:, ::-1])


def test_parts_are_where_the_bodys_own_kinematics_puts_them(simulation: Simulation) -> None:
    rng = np.random.default_rng(4)
    put(simulation, "robot", load_robot("quadruped"), rng)
    simulation.step(3)
    base, body = simulation.base("robot"), simulation.bodies["robot"]
    turn = Rotation.from_quat(base[3:])
    for frame, pose in zip(
        simulation.frames("robot"), body.poses(simulation.joints("robot")).values(), strict=True
    ):
        assert frame[:3] == pytest.approx(base[:3] + turn.apply(pose[:3, 3]), abs=1e-5)
        assert (
            Rotation.from_quat(frame[3:]).inv() * turn * Rotation.from_matrix(pose[:3, :3])
        ).magnitude() < 1e-4


def with_analytic(scenario: Scenario, **rig: object) -> Scenario:
    return scenario.model_copy(
        update={"rig": scenario.rig.model_copy(update={"renderer": "analytic", **rig})}
    )


def test_the_world_shows_the_same_scene_with_either_renderer(scenario: Scenario) -> None:
    """Through the whole camera: the same background, noise and bodies; a seed repeats the episode bit for bit."""
    shown = {}
    for renderer in ("tinyrenderer", "analytic", "analytic"):
        world = testbed.parallel_env(with_analytic(scenario, renderer=renderer))
        world.reset(seed=3)
        for _ in range(40):
            observations, *_ = world.step(
                {agent: np.full(world.action_space(agent).shape, -0.52) for agent in world.agents}
            )
        pair = np.stack([observations["student"][side].astype(int) for side in ("left", "right")])
        assert renderer == "tinyrenderer" or renderer not in shown or np.array_equal(shown[renderer], pair)
        shown[renderer] = pair
        world.close()
    theirs, ours = shown["tinyrenderer"], shown["analytic"]
    assert np.abs(theirs - ours).mean() < 4.0  # noise of 2 in each: 2.3 of it
    dark = theirs < 180, ours < 180
    assert (dark[0] & dark[1]).sum() / (dark[0] | dark[1]).sum() > 0.8  # half a pixel of a limb of two
    empty = (theirs == 255) & (ours == 255)
    assert empty.mean() > 0.2
    assert ours[ours > 200].std() == pytest.approx(theirs[theirs > 200].std(), rel=0.05)


def test_a_limb_that_falls_off_is_no_longer_seen(scenario: Scenario) -> None:
    damaged = scenario.student.model_copy(update={"damage": DamageSpec(limb_lost="limb_a", at=0.15)})
    here = with_analytic(scenario, camera_rate=60, camera_noise=0, pan_limit_deg=180, pan_speed_deg=3600)
    backend = SimulatedBackend(here.model_copy(update={"student": damaged}))
    dark = []
    for _ in range(12):
        backend.apply({"student": np.zeros(2)}, math.pi)
        dark.append(int((backend.look() < 200).sum()))
    backend.close()
    assert 0 < dark[-1] < 0.8 * dark[6]


def test_a_body_that_cannot_be_drawn_is_refused_in_one_line(tmp_path: Path) -> None:
    urdf = Path(pybullet_data.getDataPath()) / "r2d2.urdf"
    file = tmp_path / "mesh.yaml"
    file.write_text(
        "rig: {renderer: analytic}\n"
        "teachers:\n"
        f"  - {{robot: '{urdf}', scale: 0.3, gait: still, distance: 1.5}}\n"
    )
    with pytest.raises(
        UserError, match=r"mesh.yaml:3: .*cannot draw part '\w+' of robot '\w+', a mesh; write"
    ) as told:
        check(load_scenario(file))
    assert "\n" not in str(told.value)
    with pytest.raises(UserError, match=r"a mesh; write 'rig: \{renderer: tinyrenderer\}'"):
        testbed.parallel_env(load_scenario(file))


def test_a_texture_is_refused(simulation: Simulation) -> None:
    ball = load_robot("ball").varied(parts={"body": {"texture": {"pattern": "stripes"}}})
    with pytest.raises(UserError, match="part 'body' of robot 'ball', which has a texture"):
        solids_of(ball)


def test_quick_noise_is_normal() -> None:
    noise = QuickNoise(np.random.PCG64(1)).normal(3.0, 2.0, (200, 500))
    assert noise.dtype == np.float32
    assert noise.mean() == pytest.approx(3.0, abs=0.02)
    assert noise.std() == pytest.approx(2.0, rel=0.01)
    assert stats.kstest(noise.ravel(), stats.norm(3.0, 2.0).cdf).pvalue > 0.01
    assert abs(np.corrcoef(noise[:, :-1].ravel(), noise[:, 1:].ravel())[0, 1]) < 0.01
    assert np.array_equal(noise, QuickNoise(np.random.PCG64(1)).normal(3.0, 2.0, (200, 500)))
    assert isinstance(QuickNoise(np.random.PCG64(1)).normal(), float)
