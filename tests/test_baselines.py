"""Baselines: what they may know, what they go by, and that nobody else is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from testbed.bodies.morphology import Vector, load_robot
from testbed.experiment.trial import run_trial, senses_of, student_of
from testbed.experiment.witness import Witness
from testbed.scenario import parse_scenario, with_overrides
from testbed.student.insider import Insider, insight
from testbed.student.methods import METHODS
from testbed.student.motion import Watched
from testbed.student.parameters import GlanceParameters
from testbed.student.seeing.glance import _from_the_side, album, glance, look_of
from testbed.vision.camera import StereoRig
from testbed.vision.primitives import OMEGA
from testbed.vision.silhouette import coverage

RIG = StereoRig()
TWO = """
seed: 3
student: {student}
beside: {beside}
teachers:
  - {{robot: crawler, gait: crawl, distance: 0.8, bearing_deg: -30}}
  - {{robot: ball, gait: roll, distance: 1.4, bearing_deg: 30, appropriate: false}}
"""
BASELINES = "[random, nearest, lookalike, known_body, oracle]"


def forbidden(bearing: float, steps: tuple[int, ...]) -> Vector | None:
    raise AssertionError("somebody asked for the truth")


def test_only_baselines_are_told_the_truth() -> None:
    privileged = {name for name, phases in METHODS.items() if phases.privileged}
    assert privileged == {"random", "nearest", "lookalike", "known_body", "oracle"}
    scenario = parse_scenario(TWO.format(student="like_me", beside="[paper]"), Path("two.yaml"))
    insider = Insider(scenario.student.body(), forbidden)
    student = student_of(scenario, np.random.SeedSequence(0), insider=insider)
    assert all(mind._insider is None for mind in student._minds)
    scenario = parse_scenario(TWO.format(student="oracle", beside="[]"), Path("two.yaml"))
    with pytest.raises(ValueError, match="told the truth"):
        student_of(scenario, np.random.SeedSequence(0))


def test_every_baseline_judges_the_same_candidates() -> None:
    scenario = parse_scenario(TWO.format(student="paper", beside=BASELINES), Path("two.yaml"))
    result = run_trial(with_overrides(scenario, smoke=True), 0)
    rows = {(row["student"], row["teacher"]): row for row in result.rows if row["kind"] == "verdict"}
    assert len(rows) == 12
    assert all(row["found"] for row in rows.values())
    near, far = rows["nearest", "teacher_0"], rows["nearest", "teacher_1"]
    assert float(near["score"] or 0) > float(far["score"] or 0)
    assert rows["lookalike", "teacher_1"]["verdict"] == "inappropriate"
    assert float(rows["lookalike", "teacher_0"]["score"] or 0) > float(
        rows["lookalike", "teacher_1"]["score"] or 0
    )
    assert rows["oracle", "teacher_1"]["verdict"] == "inappropriate"
    assert rows["oracle", "teacher_0"]["motion_roll_error_median_deg"] == pytest.approx(0, abs=1e-6)
    assert rows["random", "teacher_0"]["controller_verdict"] is None


def test_the_oracle_finds_everybodys_joints_where_they_are() -> None:
    from testbed.world.bullet import SimulatedBackend

    scenario = parse_scenario(TWO.format(student="oracle", beside="[]"), Path("two.yaml"))
    backend = SimulatedBackend(scenario)
    witness = Witness(scenario, backend)
    witness.note()
    parts = witness.parts_of(np.radians(-28), (1,))
    assert parts is not None
    assert parts.shape == (1, 3, 8)
    assert np.allclose(parts[0, :, OMEGA], 0, atol=1e-6)  # flat
    assert witness.parts_of(np.radians(120), (1,)) is None
    backend.close()


@pytest.mark.parametrize("there", [1, 2, 3, 4])
def test_a_truth_with_another_number_of_parts_is_cut_to_measure(there: int) -> None:
    rng = np.random.default_rng(there)
    parts = rng.normal(size=(5, there, 8))
    told = insight(np.arange(5.0), parts, 3)
    assert told.motion.parts.shape == (5, 3, 8)
    assert told.explained == min(there, 3) / max(there, 3)
    assert np.array_equal(told.motion.parts[:, 0, :OMEGA], parts[:, 0, :OMEGA])
    assert insight(np.arange(5.0), None, 3).explained == 0


@settings(max_examples=25, deadline=None)
@given(st.integers(2, 4), st.integers(-20, 20), st.floats(-1, 1), st.floats(-1, 1))
def test_looks_do_not_depend_on_size_or_place(larger: int, shift: int, a: float, b: float) -> None:
    body = load_robot("crawler")
    image = coverage(_from_the_side(body, np.array([a, b]), 0.0, 1.2), RIG)[0]
    columns = np.flatnonzero(image.any(axis=0)) + shift
    assume(columns[0] >= 0 and columns[-1] < image.shape[1])  # it stays whole in view
    small, moved, large = map(
        look_of, (image, np.roll(image, shift, axis=1), np.kron(image, np.ones((larger, larger))))
    )
    assert small is not None
    assert moved is not None
    assert large is not None
    assert np.allclose(small, moved, atol=1e-6)
    assert np.allclose(small[:2], large[:2], atol=1e-9)
    assert np.allclose(small[2:4], large[2:4], atol=0.2)  # the hull and the moments are of pixels


def test_the_own_kind_looks_more_like_itself_than_others_do() -> None:
    rng = np.random.default_rng(0)
    own, parameters = load_robot("crawler"), GlanceParameters(pictures=100)
    likeness = {}
    for name in ("crawler", "splayed", "ball"):
        body = load_robot(name)
        frames = []
        for _ in range(12):
            posture = np.asarray(rng.uniform(*body.limits.T), float) if len(body.joints) else np.zeros(0)
            cover = coverage(_from_the_side(body, posture, 0.0, 1.0), RIG)
            frames.append(np.round(250 - 160 * cover).astype(np.uint8))
        watched = Watched(np.array(frames), np.arange(12.0))
        seen = glance(watched, RIG, own, parameters, np.random.default_rng(1))
        likeness[name] = seen.likeness
        assert seen.distance == pytest.approx(1.0, rel=0.1)
    assert likeness["crawler"] > likeness["splayed"] > likeness["ball"]


def test_nothing_to_see_is_no_look() -> None:
    assert look_of(np.zeros((75, 100))) is None
    assert album(
        load_robot("crawler"), RIG, GlanceParameters(pictures=10), np.random.default_rng(0)
    ).shape == (10, 7)
    assert senses_of(parse_scenario(TWO.format(student="paper", beside="[]"), Path("two.yaml"))).rig == RIG
