from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from testbed.bodies.morphology import load_robot
from testbed.errors import UserError
from testbed.scenario import (
    GaitSpec,
    RigSpec,
    Scenario,
    StudentSpec,
    TeacherSpec,
    as_scenario,
    check,
    parse_scenario,
)
from testbed.world.optics import projection_matrix, view_matrix
from testbed.world.placement import placements

STILL = GaitSpec(kind="still")
BODIES = {name: load_robot(name) for name in ("crawler", "splayed")}
GOOD = "teachers:\n  - robot: crawler\n    gait: crawl\n"


def refused(text: str) -> str:
    scenario = parse_scenario(text, "x.yaml")
    with pytest.raises(UserError) as caught:
        check(scenario)
    assert caught.value.mend
    return str(caught.value)


def passes(scenario: Scenario) -> bool:
    try:
        check(scenario)
    except UserError:
        return False
    return True


def test_a_sound_scenario_passes() -> None:
    check(parse_scenario(GOOD))


@pytest.mark.parametrize(
    ("text", "line", "fragments"),
    [
        (GOOD.replace("crawler", "crawlr"), 2, ["unknown robot 'crawlr'", "did you mean 'crawler'?"]),
        (GOOD + "student:\n  robot: craler", 5, ["unknown robot 'craler'", "did you mean 'crawler'?"]),
        (GOOD.replace("crawler", "./nobody.yaml"), 2, ["there is no such file"]),
        (GOOD.replace("crawler", "./mine.urdf"), 2, ["mine.urdf", "there is no such file"]),
        (GOOD + "student: {robot: mine.urdf}", 4, ["mine.urdf", "there is no such file"]),
        (
            "teachers:\n  - robot: crawler\n    gait:\n      joints:\n        joint_a: {}\n        joint_c: {}",
            6,
            ["joint 'joint_c', which robot 'crawler' does not have", "did you mean 'joint_"],
        ),
        (
            "teachers:\n  - robot: crawler\n    gait:\n      joints:\n"
            "        joint_b: {centre_deg: 60, amplitude_deg: 31}",
            5,
            ["from 29 to 91 degrees", "turns it from -90 to 90", "lower amplitude_deg"],
        ),
        (GOOD + "    distance: 0.5", 4, ["does not fit in view at 0.5 m", "m or farther"]),
        (GOOD + "    bearing_deg: 100", 4, ["beyond the rig's pan limit of 90", "raise rig.pan_limit_deg"]),
        (
            "rig: {pan_limit_deg: 180}\n"
            + GOOD
            + "    bearing_deg: 175\n"
            + GOOD[10:]
            + "    bearing_deg: -175",
            8,
            ["teachers 0 and 1, 10 degrees apart, share a view"],
        ),
        (
            GOOD + "    bearing_deg: 10\n  - robot: splayed\n    gait: still\n    bearing_deg: -10",
            7,
            ["teachers 0 and 1, 20 degrees apart, share a view", "degrees apart"],
        ),
    ],
)
def test_what_cannot_work_is_refused_with_its_line(text: str, line: int, fragments: list[str]) -> None:
    message = refused(text)
    assert message.startswith(f"x.yaml:{line}: ")
    for fragment in fragments:
        assert fragment in message


def test_a_mistake_in_a_robot_of_ones_own_is_told_in_its_own_file(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("name: mine\nparts:\n  body: {shape: cube}\n")
    scenario = parse_scenario("teachers: [{robot: mine.yaml, gait: still}]", tmp_path / "x.yaml")
    with pytest.raises(UserError, match=r"mine\.yaml:3: "):
        check(scenario)


def test_the_mended_distance_and_bearing_pass() -> None:
    for text, word, mended in [
        (GOOD + "    distance: 0.4", "put it at ", "    distance: {}"),
        (
            GOOD + "    bearing_deg: 0\n" + GOOD[10:] + "    bearing_deg: 20",
            "at least ",
            "    bearing_deg: {}",
        ),
    ]:
        mend = refused(text).split(word)[1].split()[0]
        head, _, _ = text.rpartition("\n")
        check(parse_scenario(f"{head}\n{mended.format(mend)}"))


PARTS = """\
name: mine
parts:
  body: {shape: cuboid, size: [0.14, 0.11, 0.05]}
  upper: {shape: capped_cylinder, radius: 0.01, length: 0.2}
  lower: {shape: capped_cylinder, radius: 0.01, length: 0.2}
joints:
"""
UPPER = "  a: {parent: body, child: upper, angle_deg: 20}\n"
LOWER = "  b: {parent: upper, child: lower, angle_deg: -30}\n"


def checked(folder: Path, robot: str) -> None:
    (folder / "mine.yaml").write_text(robot)
    check(parse_scenario(GOOD + "student:\n  robot: mine.yaml\n", folder / "x.yaml"))


@pytest.mark.parametrize(
    "robot",
    [
        PARTS + UPPER + LOWER,
        PARTS + UPPER + "  b: {parent: body, child: lower, angle_deg: 200}\n",
    ],
)
def test_a_student_that_a_genome_describes_passes(tmp_path: Path, robot: str) -> None:
    checked(tmp_path, robot)


@pytest.mark.parametrize(
    ("robot", "fragments"),
    [
        (PARTS.replace("joints:", "joints: {}").split("  upper")[0], ["1 to 26 joints", "'mine' has 0"]),
        (PARTS + LOWER + UPPER, ["list the joints from the main body outward"]),
        (PARTS + UPPER + LOWER.replace("-30}", "-30, along: 0.5}"), ["hinges at the far end"]),
        (PARTS + UPPER.replace("20}", "20, height: 0.02}") + LOWER, ["at height 0"]),
    ],
)
def test_a_student_that_no_genome_describes_is_refused(
    tmp_path: Path, robot: str, fragments: list[str]
) -> None:
    with pytest.raises(UserError) as caught:
        checked(tmp_path, robot)
    assert str(caught.value).startswith(f"{tmp_path / 'x.yaml'}:5: ")
    for fragment in fragments:
        assert fragment in str(caught.value)


@pytest.mark.parametrize(
    ("text", "line", "fragment"),
    [
        ("student:\n  position: [0, 2]\n", 5, "comes into the rig's view; move student.position behind"),
        ("student:\n  position: [1.5, -0.3]\n", 5, "comes into the rig's view"),  # a limb would reach in
        ("student:\n  position: [0, -0.3]\n", 5, "touches the rig's post"),
        ("rig:\n  pan_limit_deg: 130\n", 5, "or lower rig.pan_limit_deg"),
        ("student:\n  position: [0, 1.2]\nrig: {pan_limit_deg: 20}\n", 5, "comes into the rig's view"),
    ],
)
def test_a_student_in_the_way_is_refused(text: str, line: int, fragment: str) -> None:
    message = refused(GOOD + text)
    assert message.startswith(f"x.yaml:{line}: ")
    assert fragment in message


@settings(max_examples=60, deadline=None)
@given(limit=st.floats(0, 170), view=st.floats(20, 100), place=st.floats(-180, 180), away=st.floats(0.7, 3))
def test_the_student_passes_where_no_camera_sees_any_of_it_however_it_turns(
    limit: float, view: float, place: float, away: float
) -> None:
    rig = RigSpec(pan_limit_deg=limit, field_of_view_deg=view)
    centre = away * np.array([math.sin(math.radians(place)), math.cos(math.radians(place))])
    student = StudentSpec(position=(float(centre[0]), float(centre[1])))
    teacher = TeacherSpec(robot="crawler", gait=STILL, distance=5)
    scenario = Scenario(name="x", rig=rig, student=student, teachers=(teacher,))
    around = np.linspace(0, 2 * math.pi, 90)[:, None]

    def shown(radius: float) -> bool:
        ring = centre + np.concatenate(
            [share * radius * np.hstack([np.cos(around), np.sin(around)]) for share in (0, 0.5, 1)]
        )
        points = np.column_stack([ring, np.full(len(ring), rig.height)])
        pans = np.radians(np.linspace(-limit, limit, 60))
        return any(seen(points, rig, pan).any() for pan in pans)

    reach = max(map(abs, BODIES["crawler"].reach()[:2]))
    if shown(reach - 0.01):
        assert not passes(scenario)
    elif not shown(reach + 0.05):
        assert passes(scenario)


def test_shipped_scenarios_pass() -> None:
    for name in ("paper", "whom_to_imitate"):
        as_scenario(name)


def seen(points: np.ndarray, rig: RigSpec, pan: float) -> np.ndarray:
    """(2, N) whether the renderer's own matrices put world points (N, 3) inside the left and the right image."""
    right = np.array([math.cos(pan), -math.sin(pan), 0.0])
    ahead = np.array([math.sin(pan), math.cos(pan), 0.0])
    projection = np.reshape(projection_matrix(math.radians(rig.field_of_view_deg), 100, 75), (4, 4)).T
    inside = []
    for side in (-0.5, 0.5):
        eye = np.array([0, 0, rig.height]) + side * rig.baseline * right
        view = np.reshape(view_matrix(eye, eye + ahead), (4, 4)).T
        clip = np.column_stack([points, np.ones(len(points))]) @ view.T @ projection.T
        inside.append((clip[:, 3] > 0) & (np.abs(clip[:, :2]) <= clip[:, 3:]).all(axis=1))
    return np.array(inside)


def body_points(scenario: Scenario, index: int, count: int) -> np.ndarray:
    """(N, 3) points along the flat body on the ground, and the highest point above its middle."""
    named = {f"teacher_{i}": BODIES[str(teacher.robot)] for i, teacher in enumerate(scenario.teachers)}
    body = named[f"teacher_{index}"]
    spot = placements(scenario, named)[f"teacher_{index}"]
    least, most, highest = body.reach()
    along = np.linspace(least, most, count)[:, None]
    flat = np.array(spot.place) + along * (math.cos(spot.yaw), math.sin(spot.yaw))
    points = np.column_stack([flat, np.zeros(count)])
    middle = flat.mean(axis=0)
    return np.vstack([points, [*middle, 0.0], [*middle, highest]])


angles = st.floats(-180, 180)


@settings(max_examples=60, deadline=None)
@given(
    robot=st.sampled_from(["crawler", "splayed"]),
    bearing=st.floats(-90, 90),
    facing=angles,
    view=st.floats(20, 100),
    baseline=st.floats(0.01, 0.3),
    height=st.floats(0.02, 0.6),
)
def test_a_body_passes_from_the_distance_on_where_both_cameras_see_all_of_it(
    robot: str, bearing: float, facing: float, view: float, baseline: float, height: float
) -> None:
    rig = RigSpec(field_of_view_deg=view, baseline=baseline, height=height)

    def at(distance: float) -> Scenario:
        teacher = TeacherSpec(
            robot=robot, gait=STILL, distance=distance, bearing_deg=bearing, facing_deg=facing
        )
        return Scenario(name="x", rig=rig, teachers=(teacher,))

    def visible(distance: float) -> bool:
        points = body_points(at(distance), 0, 2)
        points[:2, 2] = (
            height  # the ends must be seen in width, the middle in height: limbs rise from their hinges
        )
        return bool(seen(points, rig, math.radians(bearing)).all())

    near, far = 0.3, 5.0
    if visible(near):
        assert passes(at(near))
    elif not visible(far):
        assert not passes(at(far))
    else:
        while far - near > 1e-4:
            middle = (near + far) / 2
            near, far = (near, middle) if visible(middle) else (middle, far)
        assert passes(at(far + 1e-3))
        assert not passes(at(near - 1e-3) if near > 0.301 else at(near))


@settings(max_examples=40, deadline=None)
@given(
    bearing=st.floats(-90, 0),
    facings=st.tuples(angles, angles),
    distances=st.tuples(st.floats(0.9, 2), st.floats(0.9, 2)),
)
def test_teachers_may_stand_no_nearer_than_where_one_enters_the_view_of_the_other(
    bearing: float, facings: tuple[float, float], distances: tuple[float, float]
) -> None:
    def apart(separation: float) -> Scenario:
        teachers = tuple(
            TeacherSpec(
                robot=robot, gait=STILL, distance=distance, bearing_deg=bearing + more, facing_deg=facing
            )
            for robot, distance, more, facing in zip(
                BODIES, distances, (0.0, separation), facings, strict=True
            )
        )
        student = StudentSpec(position=(0.0, -8.0))  # far from where the rig looks
        return Scenario(name="x", rig=RigSpec(pan_limit_deg=130), student=student, teachers=teachers)

    def shared(scenario: Scenario) -> bool:
        return any(
            seen(
                body_points(scenario, other, 50),
                scenario.rig,
                math.radians(scenario.teachers[mine].bearing_deg),
            ).any()
            for mine, other in ((0, 1), (1, 0))
        )

    near, far = 0.0, 120.0
    assert shared(apart(near))
    assert not shared(apart(far))
    while far - near > 1e-3:
        middle = (near + far) / 2
        near, far = (middle, far) if shared(apart(middle)) else (near, middle)
    assert not passes(apart(near - 0.01))
    if all(passes(apart(120).model_copy(update={"teachers": (one,)})) for one in apart(120).teachers):
        assert passes(apart(far + 8))  # the margin for the two cameras' places stays small
