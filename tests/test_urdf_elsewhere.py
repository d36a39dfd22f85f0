"""Robots that PyBullet ships: they become bodies, or are refused in a line that tells why."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pybullet_data
import pytest

from testbed.bodies.morphology import load_robot
from testbed.errors import UserError

DATA = Path(pybullet_data.getDataPath())
ELSEWHERE = {
    "a1/a1.urdf": (13, 12),
    "laikago/laikago.urdf": (13, 12),
    "quadruped/minitaur.urdf": (17, 16),
    "cloth_z_up.urdf": (1, 0),  # it is flat
    "cartpole.urdf": (2, 1),
    "bicycle/bike.urdf": (4, 3),  # commas between its numbers
}


@pytest.mark.parametrize("name", ELSEWHERE)
def test_more_robots_that_others_ship(name: str) -> None:
    body = load_robot(DATA / name)
    assert (len(body.parts), len(body.joints)) == ELSEWHERE[name]
    assert np.isfinite(body.reach()).all()
    assert 0 < body.mass < np.inf


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (
            "biped/biped2d_pybullet.urdf",
            "115: 'lower' of <limit> must be 1 finite number; write 1, not '-1.57.'",
        ),
        ("cube_rotate.urdf", "link 'world' has no shape that can be read"),
        ("differential/diff_ring.urdf", "24: mesh 'differential/diff_ring.stl' is not there"),
        ("humanoid/humanoid.urdf", "40: there are no spherical joints"),
        ("husky/husky.urdf", "97: this is xacro and not yet URDF; expand it"),
        ("kuka_iiwa/model_for_sdf.urdf", "76: mesh 'meshes/coarse/link_0.stl' is not there"),
        ("quadruped/microtaur/microtaur.urdf", "300: 'rpy' of <origin> must be 3 finite numbers"),
        ("racecar/racecar_differential.urdf", "16: 'scale' of <mesh"),
        ("random_urdfs/168/168.urdf", "168.obj: the mesh holds no surface"),
        ("torus_deform.urdf", "the robot has no links"),
    ],
)
def test_what_is_no_robot_of_ours_is_told_in_a_line(name: str, said: str) -> None:
    with pytest.raises(UserError) as caught:
        load_robot(DATA / name)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
