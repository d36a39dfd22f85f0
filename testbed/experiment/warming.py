"""What looking at others takes is compiled in a process of its own, once, while the student still finds itself.

Compiling is half typing in Python and half LLVM, both under a lock of the process: a second core is of use only to a
second process. What that one has compiled is on the disk before the first student looks at anybody. It is merely
sooner there: whatever goes wrong, the trial compiles what it needs.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator

import numpy as np


@contextlib.contextmanager
def warming() -> Iterator[None]:
    """Compile beside what is done meanwhile, if there is a second core and anything to compile."""
    if len(os.sched_getaffinity(0)) < 2 or not _cold():
        yield
        return
    process = subprocess.Popen(
        [sys.executable, "-m", __name__],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield
    finally:
        process.kill()
        process.wait()


def _cold() -> bool:
    from testbed.student.seeing import _bundle, _eea  # slow to load, but the trial needs them
    from testbed.vision._jit import is_kept

    return not (is_kept(_eea.run_passes) and is_kept(_bundle.linearised))


def compile_seeing() -> None:
    """Call what looks at others once, on a white picture."""
    from testbed.bodies.parts import Cuboid
    from testbed.student.parameters import TeacherModellingParameters
    from testbed.student.seeing import _bundle
    from testbed.student.seeing.articulated import Limb, describe, eyes_of, lay_out
    from testbed.student.seeing.teacher_modelling import Modelling
    from testbed.vision import StereoRig, render

    rig, frames = StereoRig(), np.zeros(1, np.int64)
    body = lay_out((Limb(part=Cuboid(size=(0.1, 0.1, 0.1)), parent=None),))
    eyes = eyes_of(np.zeros((1, 2, rig.height, rig.width), np.float32), rig)
    x = np.zeros((1, body.pose + body.shared))
    x[0, body.find("depth")] = 1.0
    _bundle.linearised(body.plan, 1, eyes, frames, x, np.arange(2), np.full(2, 1e-3))
    _bundle.fan_costs(body.plan, 1, 0, eyes, frames, x, np.zeros(1), np.zeros(1))
    parts = describe(body, x)[0]
    white = np.full((rig.height, rig.width), 255, np.uint8)
    brief = TeacherModellingParameters(passes_per_image=1)
    Modelling(rig, 1, brief, np.random.default_rng(0)).observe(white, white)
    render(parts, rig)


if __name__ == "__main__":
    compile_seeing()
