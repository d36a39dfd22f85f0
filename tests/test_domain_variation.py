"""Each piece of domain variation changes what it says and nothing else; left out, it changes nothing at all."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from testbed.bodies.morphology import Vector
from testbed.errors import UserError
from testbed.scenario import check, drawn, parse_scenario
from testbed.scenario.variation import chance
from testbed.world.bullet import SimulatedBackend
from testbed.world.env import World
from testbed.world.flaws import Lag
from testbed.world.gaits import scripted_policy

Episode = Mapping[str, Vector]
BASE: dict[str, Any] = {
    "name": "it",
    "teachers": [
        {"robot": "crawler", "gait": "crawl", "distance": 1.0},
        {"robot": "ball", "gait": "roll", "distance": 1.2, "bearing_deg": 60},
    ],
}


def scenario_with(**changes: Any) -> Any:
    data = {**BASE, **{key: value for key, value in changes.items() if key != "teacher"}}
    data["teachers"] = [{**data["teachers"][0], **changes.get("teacher", {})}, *data["teachers"][1:]]
    return parse_scenario(json.dumps(data))


def episode(scenario: Any, *, steps: int = 50, pan: float = 0.0) -> Episode:
    """What the student senses and what is true, of a student that moves a little; the same seeds each time."""
    scenario = drawn(scenario, 0)
    backend = SimulatedBackend(scenario)
    world = World(scenario, backend=backend)
    policies = [
        scripted_policy(teacher.gait, backend.robots[f"teacher_{index}"], scenario.world.control_step)
        for index, teacher in enumerate(scenario.teachers)
    ]
    observations, _ = world.reset(seed=3)
    log: dict[str, list[Any]] = {
        "tilt": [],
        "left": [],
        "right": [],
        "student": [],
        "teacher_0": [],
        "teacher_1": [],
    }
    for step in range(steps):
        acts = {f"teacher_{i}": policy.act(observations[f"teacher_{i}"]) for i, policy in enumerate(policies)}
        acts["student"] = np.array([0.5 * math.sin(step / 9), 0.4 if step > 20 else 0.0, pan], np.float32)
        observations, *_ = world.step(acts)
        for sense in ("tilt", "left", "right"):
            log[sense].append(observations["student"][sense])
        for name in ("student", "teacher_0", "teacher_1"):
            log[name].append(np.concatenate(backend.state(name)))
    world.close()
    return {name: np.array(values) for name, values in log.items()}


@pytest.fixture(scope="module")
def plain() -> Episode:
    return episode(scenario_with())


SENSED, TRUE = ("tilt", "left", "right"), ("student", "teacher_0", "teacher_1")
SEEN = ("left", "right")
NEUTRAL = {
    "rig": {"blur": 0.0, "gain": 1.0, "frame_drops": 0.0},
    "world": {"clutter": [], "arrangement": "apart"},
    "student": {"method": "paper", "reality_gap": {"servo_lag": 0.0}},
    "teacher": {
        "density": 1.0, "friction": 1.0, "luminosity": None, "texture": None, "height": 0.0, "away": [],
        "gait": {"preset": "crawl", "mirrored": False, "stretched": 1.0},
    },
}  # fmt: skip
BESIDE = {"shape": "box", "size": [0.1, 0.1, 0.2], "distance": 0.8, "bearing_deg": 20}


@pytest.mark.parametrize(
    ("changes", "touched"),
    [
        (NEUTRAL, ()),
        ({"rig": {"blur": 1.0}}, SEEN),
        ({"rig": {"gain": 0.9}}, SEEN),
        ({"rig": {"frame_drops": 0.5}}, SEEN),
        ({"rig": {"camera_noise": 3.0}}, SEEN),
        ({"rig": {"light": {"ambient": 0.4}}}, SEEN),
        ({"world": {"clutter": [BESIDE]}}, SEEN),
        ({"world": {"clutter": [{**BESIDE, "bearing_deg": -120}]}}, ()),
        ({"teacher": {"luminosity": 60}}, SEEN),
        ({"teacher": {"texture": {"pattern": "stripes"}}}, SEEN),
        ({"teacher": {"friction": 0.3}}, (*SEEN, "teacher_0")),
        ({"teacher": {"density": 3.0}}, (*SEEN, "teacher_0")),
        ({"teacher": {"height": 0.05}}, (*SEEN, "teacher_0")),
        ({"teacher": {"away": [[0.3, 0.5]]}}, (*SEEN, "teacher_0")),
        ({"teacher": {"scale": 0.8}}, (*SEEN, "teacher_0")),
        ({"teacher": {"distance": 1.1}}, (*SEEN, "teacher_0")),
        ({"teacher": {"facing_deg": 10}}, (*SEEN, "teacher_0")),
        ({"world": {"tilt_noise_deg": 1.0}}, ("tilt",)),
        ({"student": {"method": "paper", "reality_gap": {"tilt_bias_deg": [1.0, -1.0]}}}, ("tilt",)),
        (
            {"student": {"method": "paper", "reality_gap": {"servo_offset_deg": [3.0, 0.0]}}},
            ("tilt", "student"),
        ),
        ({"student": {"method": "paper", "reality_gap": {"servo_lag": [0.1, 0.0]}}}, ("tilt", "student")),
    ],
    ids=lambda value: "" if isinstance(value, tuple) else str(value)[:60],
)
def test_it_changes_what_it_says_and_nothing_else(
    plain: Episode, changes: dict[str, Any], touched: tuple[str, ...]
) -> None:
    varied = episode(scenario_with(**changes))
    different = {name for name in (*SENSED, *TRUE) if varied[name].tobytes() != plain[name].tobytes()}
    assert different == set(touched)


def test_all_of_them_can_be_drawn() -> None:
    """Anew for each trial, each by itself, and the same again for the same trial."""
    u = {"uniform": [0.5, 1.0]}
    scenario = scenario_with(
        rig={"blur": u, "gain": {"uniform": [0.8, 1.0]}, "frame_drops": {"uniform": [0.1, 0.6]}},
        world={"clutter": [{"distance": u, "bearing_deg": u, "luminosity": u, "facing_deg": u}]},
        student={"method": "paper", "reality_gap": {"servo_lag": {"uniform": [-0.1, 0.1]}}},
        teacher={
            "density": u, "friction": u, "luminosity": u, "height": u, "texture": {"contrast": u},
            "gait": {"preset": "crawl", "stretched": u, "mirrored": {"choice": [True, False]}},
        },
    )  # fmt: skip
    one, again, other = drawn(scenario, 0), drawn(scenario, 0), drawn(scenario, 1)
    assert one == again != other
    teacher = one.teachers[0]
    expected = chance(scenario.seed, 0, ("teachers", 0, "density")).uniform(0.5, 1.0)
    assert teacher.density == expected
    values = [
        teacher.density,
        teacher.friction,
        teacher.luminosity,
        teacher.height,
        one.rig.blur,
        one.rig.gain,
    ]
    assert len(set(values)) == len(values)
    gap = one.student.reality_gap
    assert gap is not None
    assert isinstance(gap.servo_lag, tuple)
    assert min(gap.servo_lag) >= 0


def test_frames_that_arrive_are_the_same_with_and_without_losses(plain: Episode) -> None:
    lossy = episode(scenario_with(rig={"frame_drops": 0.6}))["left"][::4]
    whole = plain["left"][::4]  # a frame each four steps
    lost = 0
    for number in range(1, len(whole)):
        arrived = np.array_equal(lossy[number], whole[number])
        assert arrived or np.array_equal(lossy[number], lossy[number - 1])
        lost += not arrived
    assert 3 <= lost <= 11


def test_when_the_frame_that_is_seen_was_exposed() -> None:
    """What the truth is held against is the moment of the frame that arrived last."""
    scenario = scenario_with(rig={"frame_drops": 0.6, "camera_noise": 0})
    backend, world_of = SimulatedBackend(scenario), {}
    still = {"student": np.zeros(2), "teacher_0": np.zeros(2), "teacher_1": np.zeros(0)}
    for step in range(60):
        backend.look()
        world_of[step] = (backend.exposed, backend.look()[0].tobytes())
        assert backend.exposed % 4 == 0
        assert backend.exposed <= step
        backend.apply({**still, "teacher_0": np.array([step / 60, 0.5])}, 0.0)
    backend.close()
    exposed = [world_of[step][0] for step in range(60)]
    assert exposed == sorted(exposed)
    assert len(set(exposed)) < 15
    for step in range(1, 60):
        same = world_of[step][1] == world_of[step - 1][1]
        assert same or exposed[step] != exposed[step - 1]


def test_blur_keeps_the_light_and_takes_the_edges(plain: Episode) -> None:
    sharp = episode(scenario_with(rig={"camera_noise": 0}), steps=1)["left"][0].astype(float)
    soft = episode(scenario_with(rig={"camera_noise": 0, "blur": 1.5}), steps=1)["left"][0].astype(float)
    assert soft.mean() == pytest.approx(sharp.mean(), abs=0.3)
    assert np.abs(np.diff(soft, axis=1)).max() < 0.6 * np.abs(np.diff(sharp, axis=1)).max()


def test_gain_multiplies_and_saturates() -> None:
    quiet = {"camera_noise": 0}
    once = episode(scenario_with(rig=quiet), steps=1)["left"][0].astype(float)
    for gain in (0.85, 1.4):
        image = episode(scenario_with(rig={**quiet, "gain": gain}), steps=1)["left"][0]
        assert np.abs(image - np.minimum(once * gain, 255)).max() <= 1.5
    with pytest.raises(UserError, match=r"times rig.gain of 0.5 is not above"):
        scenario_with(rig={"gain": 0.5})


@given(st.lists(st.integers(0, 5), min_size=1, max_size=3), st.integers(1, 30))
@settings(max_examples=40, deadline=None)
def test_late_servos_hear_what_was_said_before(late: list[int], length: int) -> None:
    lag = Lag(np.array(late))
    said = np.random.default_rng(0).normal(size=(length, len(late)))
    for step in range(length):
        heard = lag.heard(said[step])
        for joint, steps in enumerate(late):
            assert heard[joint] == said[max(0, step - steps), joint]


def test_who_is_away_is_not_seen_and_returns_to_where_it_was() -> None:
    log = episode(scenario_with(teacher={"away": [[0.3, 0.6]], "gait": "still"}, rig={"camera_noise": 0}))
    dark = (log["left"] < 200).any(axis=(1, 2))
    assert dark[:16].all()
    assert not dark[20:34].any()
    assert dark[40:].all()
    np.testing.assert_allclose(log["teacher_0"][-1], log["teacher_0"][16], atol=2e-3)
    with pytest.raises(UserError, match="do not rise"):
        scenario_with(teacher={"away": [[2, 1]]})


def test_pedestals_carry_their_own_teacher_alone() -> None:
    """Two neighbours at different heights: each stays at its own, and the higher one is seen higher up."""
    text = """
rig: {camera_noise: 0}
teachers:
  - {robot: crawler, gait: still, distance: 1.0, bearing_deg: -25, height: 0.12}
  - {robot: crawler, gait: still, distance: 1.0, bearing_deg: 25}
"""
    backend = SimulatedBackend(parse_scenario(text))
    still = {name: np.zeros(2) for name in backend.robots}
    for _ in range(60):
        backend.apply(still, 0.0)
    heights = [backend.state(name)[0][2] for name in ("teacher_0", "teacher_1", "student")]
    assert heights == pytest.approx([0.145, 0.025, 0.025], abs=2e-3)
    rows = []
    for pan in (-25, 25):
        for _ in range(60):
            backend.apply(still, math.radians(pan))
        rows.append(np.flatnonzero((backend.look()[0] < 200).any(axis=1)).mean())
    assert rows[0] < rows[1] - 5
    backend.close()


def test_clutter_is_seen_where_it_stands_and_stays() -> None:
    text = """
rig: {camera_noise: 0}
world:
  clutter:
    - {shape: post, size: [0.05, 0.3], distance: 1.0, bearing_deg: -10, luminosity: 80}
    - {shape: ball, size: [0.16], distance: 1.0, bearing_deg: 10}
teachers: []
"""
    backend = SimulatedBackend(parse_scenario(text))
    for _ in range(20):
        backend.apply({"student": np.zeros(2)}, 0.0)
    image = backend.look()[0]
    backend.close()
    focal = 50 / math.tan(math.radians(25))
    for bearing, width, height in ((-10, 0.05, 0.3), (10, 0.16, 0.16)):
        middle = 50 + focal * math.tan(math.radians(bearing) + 0.05)
        dark = image[:, round(middle) - 12 : round(middle) + 12] < 200
        columns, rows = np.flatnonzero(dark.any(axis=0)), np.flatnonzero(dark.any(axis=1))
        assert np.ptp(columns) + 1 == pytest.approx(focal * width, abs=2.5)
        assert np.ptp(rows) + 1 == pytest.approx(focal * height, abs=3)
    with pytest.raises(UserError, match="size of a ball has 3 numbers"):
        parse_scenario("world: {clutter: [{shape: ball}]}\nteachers: []\n")


def test_teachers_may_stand_anywhere_if_the_scenario_says_so() -> None:
    text = """
world: {{arrangement: {how}}}
teachers:
  - {{robot: crawler, gait: crawl, distance: 1.0}}
  - {{robot: crawler, gait: crawl, distance: 1.5, bearing_deg: 12}}
  - {{robot: crawler, gait: crawl, bearing_deg: 150}}
"""
    check(parse_scenario(text.format(how="free")))
    with pytest.raises(UserError, match="arrangement: free"):
        check(parse_scenario(text.format(how="apart").replace("150", "80")))


def test_a_rig_that_looks_all_around_must_not_see_its_own_student() -> None:
    text = "rig: {{pan_limit_deg: 180}}\nstudent: {{position: [0, {y}]}}\nteachers: []\n"
    check(parse_scenario(text.format(y=-25)))
    with pytest.raises(UserError, match="beyond 20 m"):
        check(parse_scenario(text.format(y=-5)))


def test_textures_have_their_pattern_and_keep_their_mean() -> None:
    from testbed.bodies.parts import Texture
    from testbed.physics_bodies import pattern

    for name, patches in (("stripes", 4), ("checks", 8), ("speckles", 32)):
        shown = pattern(Texture(pattern=name, patches=patches))
        assert abs(shown.mean()) < 0.1
        assert shown.std() > 0.3
    one, other = (pattern(Texture(pattern="speckles", seed=seed)) for seed in (1, 2))
    assert not np.array_equal(one, other)


def test_where_limbs_are_attached_can_be_drawn() -> None:
    robot = {"tree": [{"on": "main", "angle_deg": {"uniform": [-30.0, 30.0]}}, {"on": "limb_a"}]}
    scenario = scenario_with(
        teacher={"robot": robot, "limb_scale": [{"uniform": [0.6, 1.4]}, 1.0], "gait": "random"}
    )
    bodies = [drawn(scenario, trial).teachers[0].body() for trial in range(4)]
    angles = [body.joints["joint_a"].angle_deg for body in bodies]
    lengths = [body.parts["limb_a"].length_along_x for body in bodies]
    assert len(set(angles)) == len(set(lengths)) == 4
    assert max(map(abs, angles)) <= 30
    assert 0.12 <= min(lengths) < max(lengths) <= 0.28
    assert {body.parts["limb_b"].length_along_x for body in bodies} == {0.2}
