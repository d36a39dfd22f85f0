"""What is compiled beside the first trial is what students call."""

from __future__ import annotations

import numpy as np

from testbed.bodies.morphology import load_robot
from testbed.experiment import warming
from testbed.student.parameters import TeacherModellingParameters
from testbed.student.seeing import _bundle, _eea
from testbed.student.seeing.alternatives import own_limbs
from testbed.student.seeing.articulated import eyes_of, lay_out
from testbed.student.seeing.bundling import settle_poses
from testbed.student.seeing.teacher_modelling import Modelling
from testbed.vision import StereoRig
from testbed.vision._jit import is_kept


def test_students_call_what_was_compiled_for_them() -> None:
    warming.compile_seeing()
    rig = StereoRig()
    parameters = TeacherModellingParameters(passes_per_image=2)
    white = np.full((2, rig.height, rig.width), 255, np.uint8)
    Modelling(rig, 3, parameters, np.random.default_rng(1)).observe(*white)
    body = lay_out(own_limbs(load_robot("crawler"))[0], 1)
    eyes = eyes_of(np.zeros((2, 2, rig.height, rig.width), np.float32), rig)
    settle_poses(body, eyes, np.arange(2), np.ones((2, body.pose + body.shared)))
    for function in (_eea.run_passes, _bundle.fan_costs, _bundle.linearised):
        assert is_kept(function)
        assert len(function.signatures) == 1  # type: ignore[union-attr]
