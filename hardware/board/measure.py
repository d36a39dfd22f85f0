"""How good a calibration becomes: the guided procedure on many emulated rigs, no two alike.

    python hardware/board/measure.py --rigs 20

Each rig has lenses and mounts of its own and hands that hold the board roughly as asked; images are 640 x 480 with
noise, blur, vignetting and distortion. Told is what the procedure itself reports (held-out epipolar error) and what
only an emulation knows (the true baseline, rotation and level). Takes some ten seconds a rig.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable

import numpy as np

from testbed.frames import rotation_about
from testbed.hardware.calibration.charuco import CharucoSpec
from testbed.hardware.calibration.rig import RigCalibration
from testbed.hardware.calibration.rig_fit import EPIPOLAR_LIMIT
from testbed.hardware.calibration.rig_procedure import BoardWatcher, calibrate_stereo
from testbed.hardware.clock import StillClock
from testbed.hardware.emulation.cameras import emulated_pair
from testbed.hardware.emulation.lens import RigTruth, built_rig
from testbed.hardware.emulation.poses import held, held_as_asked
from testbed.hardware.emulation.scenes import BoardScene
from testbed.hardware.emulation.truth import true_calibration
from testbed.hardware.prompt import Question, nothing

TARGET_BASELINE = 0.1e-3
"""m; what a calibration is to reach."""


def measured(seed: int) -> tuple[float, float, float, float]:
    """Epipolar error (pixels), and errors of baseline (mm), rotation and level (degrees) of one rig."""
    chance = np.random.default_rng(seed)
    truth, board, clock = built_rig(chance), CharucoSpec(), StillClock()
    scene = BoardScene(board, held(board, u=0.0, v=0.0, distance=0.4))
    left, right = emulated_pair(truth, scene, clock, seed=seed)

    def hands(question: Question, meanwhile: Callable[[], None] = nothing) -> str:
        left.scene = right.scene = BoardScene(board, held_as_asked(board, question.details, chance))
        clock.sleep(2.0)
        return ""

    watcher = BoardWatcher(left, right, clock, board)
    found = calibrate_stereo(watcher, hands, measured_baseline=round(truth.baseline * 2, 3) / 2)
    true = true_calibration(truth)
    turn = found.geometry.rotation @ true.geometry.rotation.T
    return (
        found.epipolar,
        (found.baseline - true.baseline) * 1e3,
        math.degrees(math.acos(min(1.0, (float(np.trace(turn)) - 1) / 2))),
        level_error(found, truth),
    )


def level_error(found: RigCalibration, truth: RigTruth) -> float:
    """How far (degrees) below the middle of the rectified pictures a thing appears that is far off and level."""
    rows = []
    for eye, turn in enumerate(found.geometry.rows_aligned()):
        ahead = truth.mounts[eye].axes().T @ np.array([0.0, 0.0, 1.0])
        pixel = truth.lenses[eye].project(ahead)
        level = rotation_about((-found.pitch, 0.0, 0.0))[:3, :3]
        rows.append(float(found.geometry.slopes(eye, pixel, level @ turn)[0, 1]))
    return math.degrees(math.atan(float(np.mean(rows))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rigs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0, help="of the first rig")
    wanted = parser.parse_args()
    rows = []
    for seed in range(wanted.seed, wanted.seed + wanted.rigs):
        rows.append(measured(seed))
        sys.stderr.write(f"rig {seed}: " + ", ".join(f"{value:+.3f}" for value in rows[-1]) + "\n")
    errors = np.array(rows)
    names = ("held-out epipolar error, pixels", "baseline, mm", "rotation, degrees", "level, degrees")
    limits = (EPIPOLAR_LIMIT, TARGET_BASELINE * 1e3, math.nan, math.nan)
    sys.stdout.write(
        f"N = {len(rows)} rigs\n\n| error | mean | 95% of the mean | worst | limit |\n|---|---|---|---|---|\n"
    )
    for name, values, limit in zip(names, errors.T, limits, strict=True):
        half = 1.96 * values.std(ddof=1) / math.sqrt(len(values))
        shown = "" if math.isnan(limit) else f"{limit:.2f}"
        sys.stdout.write(
            f"| {name} | {values.mean():.3f} | {values.mean() - half:.3f} to {values.mean() + half:.3f} "
            f"| {np.abs(values).max():.3f} | {shown} |\n"
        )


if __name__ == "__main__":
    main()
