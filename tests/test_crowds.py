"""Worlds of many: the shipped scenarios are sound, everybody found is judged, and who stands behind whom is told."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from testbed.bodies.morphology import load_robot
from testbed.experiment.trial import run_trial, student_of
from testbed.experiment.trial_report import match
from testbed.experiment.truth import is_like
from testbed.report.words import in_the_way
from testbed.resources import robot_names
from testbed.scenario import check, drawn, load_scenario, parse_scenario
from testbed.student.candidates import Candidate, Sight
from testbed.student.candidates_depth import PartingParameters, depths_of
from testbed.student.candidates_parting import bearing_of, body_at
from testbed.student.judging.verdict import Verdict
from testbed.student.mind import Judgement
from testbed.student.motion import TeacherMotion, Watched
from testbed.student.parameters import FittingParameters
from testbed.student.seeing.fitting import film_of
from testbed.student.seeing.left_over import LeftOverParameters, left_over
from testbed.vision.camera import StereoRig
from testbed.vision.silhouette import coverage
from testbed.world.bullet import SimulatedBackend
from testbed.world.env import World
from testbed.world.gaits import scripted_policy

Array = NDArray[np.float64]
RIG = StereoRig()


@pytest.mark.parametrize(("name", "like"), [("crowd", 1), ("nobody", 0)])
def test_how_many_are_like_the_student(name: str, like: int) -> None:
    scenario = load_scenario(name)
    check(scenario)
    for trial in range(3):
        concrete = drawn(scenario, trial)
        mine = concrete.student.body()
        assert sum(is_like(mine, teacher.body()) for teacher in concrete.teachers) == like
        assert len({teacher.robot for teacher in concrete.teachers}) == 5


ALIKE = {frozenset({"splayed", "thin_splayed"})}  # the same limbs on a thinner main body


@pytest.mark.parametrize("name", robot_names())
def test_robots_are_like_themselves_in_any_size_and_like_no_other(name: str) -> None:
    body = load_robot(name)
    assert is_like(body, body.scaled(0.6).stretched([1.3, 0.7]))
    others = [other for other in robot_names() if other != name]
    alike = [other for other in others if is_like(body, load_robot(other))]
    assert [frozenset({name, other}) for other in alike] == [pair for pair in ALIKE if name in pair]


def test_a_hinge_beside_the_middle_is_another_body() -> None:
    body = load_robot("hand")
    shifted = body.varied(joints={"joint_a": {"across": 0.0}})
    assert not is_like(body, shifted)


@given(
    st.lists(st.floats(-3, 3), min_size=1, max_size=6),
    st.lists(st.sampled_from([30, 48, -45, 83, 110, -100]), min_size=1, max_size=5, unique=True),
)
@settings(max_examples=60, deadline=None)
def test_things_that_are_nobody_take_no_teachers_place(offsets: list[float], strangers: list[int]) -> None:
    """Candidates near teachers are theirs, however many others are found elsewhere."""
    bearings = [-150.0, -70.0, 10.0, 65.0, 140.0, 175.0]
    teachers = "".join(
        f"  - {{robot: crawler, gait: crawl, bearing_deg: {bearing}}}\n" for bearing in bearings
    )
    scenario = parse_scenario(f"teachers:\n{teachers}")
    seen = {
        index: bearing + offset
        for index, (bearing, offset) in enumerate(zip(bearings, offsets, strict=False))
    }
    far = [one for one in strangers if all(abs(one - bearing) > 20 for bearing in bearings)]
    found = [*sorted([*seen.values()], reverse=True), *far]
    candidates: Any = tuple(
        SimpleNamespace(bearing=math.radians(bearing), distance=None) for bearing in found
    )
    expected = {f"teacher_{index}": found.index(bearing) for index, bearing in seen.items()}
    assert match(candidates, scenario) == expected


# One behind the other

DEPTHS = PartingParameters()


def stick_man(x: float, z: float, size: float = 1.0) -> Array:
    """Parts of a body as a crawler is one: box, and two limbs at angles."""
    return np.array(
        [
            [0, x, 0.06, z, 0, 0.14 * size, 0.11, 0.05],
            [2, x + 0.13 * size, 0.03, z, -0.5, 0.012, 0.15 * size, 0],
            [2, x + 0.26 * size, 0.02, z, 0.7, 0.012, 0.15 * size, 0],
        ]
    )


def painted(*bodies: tuple[Array, int]) -> NDArray[np.uint8]:
    """One frame (1, 2, height, width) of bodies of these grey levels, the farthest first."""
    image = np.full((2, RIG.height, RIG.width), 255.0)
    for parts, grey in bodies:
        share = coverage(parts, RIG)
        image = image * (1 - share) + grey * share
    return image.round().astype(np.uint8)[None]


@pytest.mark.parametrize("aside", [-0.25, 0.12, 0.2])
@pytest.mark.parametrize(("near", "far"), [(0.8, 1.3), (0.9, 1.5)])
def test_two_at_two_distances_are_parted(near: float, far: float, aside: float) -> None:
    front, back = stick_man(-0.2, near), [stick_man(aside + step, far) for step in (0, 0.02, 0.04, 0.06)]
    film = np.concatenate([painted((each, 100), (front, 80)) for each in back])
    depths = depths_of(film, RIG, 180, DEPTHS)
    unit = RIG.focal * RIG.baseline
    assert depths.clearness >= DEPTHS.clear
    assert (unit / depths.near, unit / depths.far) == pytest.approx((near, far), rel=0.07)
    alone, behind = painted((front, 80)), np.concatenate([painted((each, 100)) for each in back])
    kept, touched, _ = body_at(film, RIG, depths, 180, DEPTHS, near=True)
    left, _, unseen = body_at(film, RIG, depths, 180, DEPTHS, near=False)
    dark = 255 - film.astype(float)
    assert np.all((kept == film) | (left == film))  # nobody's pixels are lost
    wrong = (dark * ((kept < 240) & (alone == 255))).sum() + (dark * ((left < 240) & (behind == 255))).sum()
    assert wrong < 0.2 * dark.sum()
    assert touched.all()
    assert np.all(unseen[kept < 128])  # who is hidden there is not known


def test_of_three_in_one_outline_the_third_is_noticed() -> None:
    """Two are parted; which of them it stays with is said to be perhaps more than one."""
    places = ((0.1, 1.7, 110), (-0.1, 1.2, 100), (-0.3, 0.8, 80))
    bodies = [(stick_man(x, z), grey) for x, z, grey in places]
    sight = Sight(RIG, 180)
    seen, found = sight.parted(Candidate(0.0, (1,), Watched(painted(*bodies), np.zeros(1)), {}))
    assert len(found) == 2
    doubts = [sight.only(seen, body).several for body in found]
    assert max(doubts) >= DEPTHS.doubtful
    alone = sight.parted(Candidate(0.0, (1,), Watched(painted(*bodies[1:]), np.zeros(1)), {}))
    assert max(sight.only(alone[0], body).several for body in alone[1]) < DEPTHS.doubtful


@pytest.mark.parametrize(("more", "told"), [([], False), ([1], False), ([0], True)])
def test_a_main_body_more_is_told_from_a_limb_more(more: list[int], told: bool) -> None:
    """``more`` are parts of a second body that no body explains: 0 is its main body, 1 a limb."""
    mine, other = stick_man(-0.2, 1.0), stick_man(0.02, 1.05)
    film = film_of(
        Watched(painted((np.concatenate([mine, other[more]]), 80)), np.zeros(1)), RIG, FittingParameters()
    )
    known: Any = SimpleNamespace(motion=TeacherMotion(np.zeros(1), mine[None]))
    parameters = LeftOverParameters()
    assert (left_over(film, RIG, known, known, parameters) >= parameters.telling) == told


@given(st.floats(0.5, 2.0), st.floats(-0.2, 0.1), st.floats(0.6, 1.5))
@settings(max_examples=25, deadline=None)
def test_one_body_lies_at_one_distance(distance: float, x: float, size: float) -> None:
    film = painted((stick_man(x, distance, size), 90))
    assert depths_of(film, RIG, 180, DEPTHS).clearness < DEPTHS.doubtful


def test_nothing_and_a_single_eye_tell_no_distance() -> None:
    empty = painted()
    assert depths_of(empty, RIG, 180, DEPTHS).clearness == 0
    assert bearing_of(empty, RIG, 180) is None
    film = painted((stick_man(0, 1.3), 100), (stick_man(0, 0.8), 80))
    assert depths_of(film, replace(RIG, baseline=0.0), 180, DEPTHS).clearness == 0


@pytest.mark.parametrize("said", ["hidden", "crowded", "several", ""])
def test_what_could_not_be_seen_is_said_by_whoever_gives_reasons(said: str) -> None:
    seen = Candidate(0.0, (1,), Watched(painted(), np.zeros(1)), {}, **({said: 0.7} if said else {}))
    verdicts = {
        "like_me": Verdict("inappropriate", -3.0, 0.1, "it is a ball"),
        "paper": Verdict("inappropriate", -3.0),
    }
    judgements = {name: Judgement((0,), None, None, verdict, None) for name, verdict in verdicts.items()}  # type: ignore[arg-type]
    words = {
        "hidden": "somebody nearer stood before it in 70%",
        "crowded": "in 70% of what I saw another outline",
        "several": "more than one body may stand here",
        "": "",
    }
    judged = seen.judged(judgements, DEPTHS).judgements
    assert judged["paper"].verdict == verdicts["paper"]
    reason = judged["like_me"].verdict.reason
    assert reason.startswith("it is a ball; " + words[said]) if said else reason == "it is a ball"
    assert replace(judged["like_me"].verdict, reason="") == replace(verdicts["like_me"], reason="")


def test_the_page_says_who_could_not_be_seen_alone() -> None:
    alone = {"found": True, "crowded": 0.0, "hidden": 0.0, "several": 0.2}
    missed = {"found": False, "crowded": None, "hidden": None, "several": None}
    assert in_the_way([alone, missed, {"found": True}]) == ""
    behind, beside, two = {"hidden": 0.4, "crowded": 0.4}, {"crowded": 0.3}, {"several": 0.7}
    bulky = {"left_over": 0.02}
    said = in_the_way([alone, missed, *({**alone, **each} for each in (behind, beside, two, bulky))])
    assert "1 of 5 candidates stood partly behind somebody else." in said
    assert "The outlines of 1 of 5 ran into another's." in said
    assert "1 of 5 lay at two distances: more than one body may have stood there" in said
    assert "Of 1 of 5 more was left unexplained than limbs" in said


def test_who_stand_in_one_direction_are_matched_by_their_distances() -> None:
    teachers = "".join(
        f"  - {{robot: crawler, gait: crawl, bearing_deg: {bearing}, distance: {distance}}}\n"
        for bearing, distance in ((20, 0.8), (20, 1.3), (70, 0.9))
    )
    scenario = parse_scenario(f"world: {{arrangement: free}}\nteachers:\n{teachers}")
    seen = ((19.0, 1.25), (22.0, 0.82), (71.0, None))
    candidates: Any = tuple(SimpleNamespace(bearing=math.radians(b), distance=d) for b, d in seen)
    assert match(candidates, scenario) == {"teacher_0": 1, "teacher_1": 0, "teacher_2": 2}


def test_a_life_with_one_behind_the_other() -> None:
    """As one outline they are like nobody; told apart, the one behind is like the student as far as it can be seen."""
    scenario = parse_scenario(
        "student: {method: known_body, imitation: none}\n"
        "world: {arrangement: free}\n"
        "rig: {renderer: analytic}\n"
        "teachers:\n"
        "  - {robot: ball, gait: roll, distance: 0.8, bearing_deg: 20}\n"
        "  - {robot: crawler, gait: crawl, distance: 1.3, bearing_deg: 23}\n"
    )
    rows: Any = [row for row in run_trial(scenario, 0).rows if row["kind"] == "verdict"]
    front, back = rows
    assert front["found"]
    assert back["found"]
    assert (front["verdict"], back["verdict"]) == ("inappropriate", "appropriate")
    assert (front["hidden"], front["several"], back["several"]) == (0, 0, 0)
    assert back["hidden"] > 0.5
    assert "somebody nearer stood before it" in back["reason"]


def test_who_stands_straight_ahead_is_not_looked_at_before_its_turn() -> None:
    """The student is busy with itself for 30 s, and who is watched crawls away."""
    text = "teachers:\n  - {robot: crawler, gait: crawl, bearing_deg: 4}\n"
    scenario = parse_scenario(f"student: paper\nrig: {{renderer: analytic, camera_rate: 1}}\n{text}")
    backend = SimulatedBackend(scenario)
    world = World(scenario, backend=backend)
    student = student_of(scenario, np.random.SeedSequence(1))
    policy = scripted_policy(scenario.teachers[0].gait, backend.robots["teacher_0"], 1 / 60)
    observations, _ = world.reset(seed=1)
    before = backend.state("teacher_0")[0][:2]
    for _ in range(400):
        acts: Any = {
            "student": student.act(observations["student"]),
            "teacher_0": policy.act(observations["teacher_0"]),
        }
        observations, *_ = world.step(acts)
    gone = np.linalg.norm(backend.state("teacher_0")[0][:2] - before)
    pan = backend.pan
    world.close()
    assert pan == pytest.approx(math.radians(-90), abs=0.01)
    assert gone < 0.03
