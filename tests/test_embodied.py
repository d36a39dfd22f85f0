"""The own body and its neighbours against films whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from films import RIG, film

from testbed.bodies.morphology import Morphology, load_robot
from testbed.student.motion import Watched
from testbed.student.parameters import EmbodiedParameters, FittingParameters
from testbed.student.seeing.alternatives import alternatives, own_limbs
from testbed.student.seeing.embodied import Embodiment, embodied

FEW = EmbodiedParameters(fitting=FittingParameters(key_frames=6))
WAVES = [(-25.0, 25.0, 0.0), (35.0, 25.0, 80.0)]


def look(
    body: Morphology, waves: list[tuple[float, float, float]], **kwargs: float
) -> tuple[Embodiment, np.ndarray]:
    watched, parts = film(body, waves, frames=12, **kwargs)
    return embodied(watched, RIG, load_robot("crawler"), FEW), parts


def test_the_own_body_is_recognised_larger_and_from_its_other_side() -> None:
    body = load_robot("crawler").scaled(1.3)
    seen, parts = look(body, WAVES, facing=-1, depth=1.3)
    assert seen.own.own
    assert seen.log_ratio > 0
    assert seen.explained > 0.98
    assert seen.scale == pytest.approx(1.3, rel=0.04)
    gap = seen.motion.parts[:, :, 4] - parts[:, :, 4]
    assert np.degrees(np.abs(np.angle(np.exp(1j * gap)))).max() < 4
    assert np.degrees(np.ptp(np.unwrap(parts[:, 2, 4] - parts[:, 1, 4]))) == pytest.approx(
        np.degrees(seen.swings[2]), abs=5
    )
    assert seen.lengths == pytest.approx([1, 1, 1], abs=0.06)
    assert np.all(seen.own.needed > 0.1)
    names = [explanation.name for explanation in seen.explanations]
    assert len(set(names)) == len(names)
    # A body with a limb more that hides behind another explains as much and says nothing: such come last.
    hiding = [bool(other.idle) and len(other.parents) > 3 for other in seen.explanations[1:]]
    assert hiding == sorted(hiding)
    rest = [
        other.log_likelihood for other, hides in zip(seen.explanations[1:], hiding, strict=True) if not hides
    ]
    assert rest == sorted(rest, reverse=True)


def test_what_is_hidden_is_not_held_against_the_own_body() -> None:
    watched, _ = film(load_robot("crawler"), WAVES, frames=12)
    _, columns = np.nonzero((watched.frames < 180).any(axis=(0, 1)))
    unseen = np.zeros(watched.frames.shape, bool)
    unseen[..., int(np.quantile(columns, 0.45)) : int(np.quantile(columns, 0.7))] = (
        True  # somebody stands there
    )
    frames = np.where(unseen, np.uint8(255), watched.frames)
    seen = embodied(Watched(frames, watched.times, unseen), RIG, load_robot("crawler"), FEW)
    assert seen.log_ratio > 0
    assert seen.own.explained > 0.97
    assert seen.scale == pytest.approx(1, rel=0.1)


@pytest.mark.parametrize(
    ("change", "waves", "name"),
    [
        ({"joint_b": {"parent": "body", "angle_deg": 180}}, WAVES, "limb_2_on_main_180"),
        ({}, [WAVES[0], (40.0, 0.0, 0.0)], "joint_2_frozen"),
        ({}, [(-30.0, 0.0, 0.0), (40.0, 0.0, 0.0)], "all_frozen"),
    ],
)
def test_others_are_told_apart_and_why(
    change: dict[str, dict[str, object]], waves: list[tuple[float, float, float]], name: str
) -> None:
    seen, _ = look(load_robot("crawler").varied(joints=change), waves)
    assert seen.log_ratio < 0
    assert seen.best_other.name == name
    assert seen.best_other.explained > 0.97
    assert seen.best_other.words.startswith(("its", "none", "the joint"))


def test_neighbours_are_one_edit_away_and_different() -> None:
    options = alternatives(own_limbs(load_robot("crawler"))[0])
    assert options[0].kind == "own"
    names = [option.name for option in options]
    assert len(set(names)) == len(names)
    assert {
        "limb_2_on_main_180",
        "joint_1_frozen",
        "all_frozen",
        "without_limb_2",
        "another_on_limb_2",
    } <= set(names)
    assert {"thin_main", "ball", "box"} <= set(names)
    for option in options:
        assert len(option.kept) == len(option.limbs)
        assert all(limb.parent is None or limb.parent < i for i, limb in enumerate(option.limbs))
        kept = [part for part in option.kept if part is not None]
        assert len(set(kept)) == len(kept)


def test_a_mirrored_body_is_not_another_body() -> None:
    # Both limbs at the front or both at the back look alike once the body faces the other way.
    splayed = load_robot("splayed")
    names = [option.name for option in alternatives(own_limbs(splayed)[0])]
    assert not ({"limb_1_on_main_180"} <= set(names) and {"limb_2_on_main"} <= set(names))
