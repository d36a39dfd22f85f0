"""Calibrating a bench's cameras: the board shown again and again, then a look around at the backdrop."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from testbed.errors import shown_path
from testbed.hardware.bench_file import RIG
from testbed.hardware.calibration.charuco import BoardView, CharucoSpec, Image
from testbed.hardware.calibration.rig import save_calibration
from testbed.hardware.calibration.rig_fit import BoardPair
from testbed.hardware.calibration.rig_procedure import PAIRS, BoardWatcher, calibrate_stereo, learn_backdrop
from testbed.hardware.clock import Clock
from testbed.hardware.operating.find import write_picture
from testbed.hardware.operating.workbench import Workbench
from testbed.hardware.prompt import Question
from testbed.hardware.rig.backdrop import save_backdrop
from testbed.hardware.rig.rectification import student_rig
from testbed.hardware.robots.robot import Robot
from testbed.scenario.specs import RigSpec

Progress = Callable[[int, int], None]
_FEEDING = 0.04  # s between two commands
_TURNING = math.radians(60)  # rad/s: slowly, there are cables
_SETTLED = 0.3  # s


def calibrate_cameras(
    place: Workbench,
    pairs: int = PAIRS,
    *,
    wanted: RigSpec | None = None,
    keep: Path | None = None,
    progress: Progress = lambda done, total: None,
) -> str:
    """Calibrate the stereo rig and learn its backdrop; returns what came of it.

    Args:
        place: The bench. Its rig's servo has to be calibrated.
        pairs: How many views of the board at least.
        wanted: The rig of the scenario to come: how wide it sees, and how far it looks around. The distance of the
            lenses is as it is; a scenario with another one is refused when it is run.
        keep: A folder for the images, with the corners that were found.
        progress: Told how many views are taken.

    Raises:
        UserError: If the board is not seen as it should be, the result is not good enough, or the backdrop is none.
    """
    spec = place.spec
    board = CharucoSpec() if spec.board_square is None else CharucoSpec(square=spec.board_square)
    wanted = wanted or RigSpec()
    tape = spec.cameras.measured_baseline if spec.cameras is not None else None

    def seen(left: Image, right: Image, pair: BoardPair, done: int, total: int) -> None:
        progress(min(done, total), total)
        for side, image, view in (("left", left, pair.left), ("right", right, pair.right)):
            if keep is not None and view is not None:
                write_picture(marked(image, view), keep / f"{done:02d}-{side}.png")

    with contextlib.ExitStack() as opened:
        left, right = place.cameras()
        for camera in (left, right):
            opened.callback(camera.close)
            camera.lock()
        watcher = BoardWatcher(left, right, place.clock, board)
        found = calibrate_stereo(watcher, place.prompt, measured_baseline=tape, pairs=pairs, seen=seen)
        text = "take the board away; the rig looks around now and learns the backdrop. Press Enter."
        place.prompt(Question("board_away", RIG, text))
        rig = opened.enter_context(place.robot(RIG))
        rig.connect()
        rig.configure()
        rig.arm()
        turn = Turning(rig, place.clock)
        eyes = student_rig(wanted.model_copy(update={"baseline": found.baseline}))
        backdrop = learn_backdrop(watcher, found, eyes, turn.to, math.radians(wanted.pan_limit_deg))
    file = save_calibration(found, spec.calibration_folder)
    save_backdrop(backdrop, spec.calibration_folder)
    return (
        f"{found.pairs} views, {found.epipolar:.2f} pixels off the row in {found.held_out} held-out ones, baseline "
        f"{1000 * found.baseline:.2f} mm; backdrop learned; kept in {shown_path(file.parent)}"
    )


class Turning:
    """Turns an armed rig slowly.

    Args:
        rig: Armed.
        clock: The bench's.
    """

    def __init__(self, rig: Robot, clock: Clock) -> None:
        self._rig, self._clock = rig, clock
        self._at = 0.0

    def to(self, angle: float) -> None:
        """Turn to an angle (rad); returns when it is there and at rest."""
        steps = max(1, math.ceil(abs(angle - self._at) / (_TURNING * _FEEDING)))
        way = np.linspace(self._at, angle, steps + 1)[1:].tolist()
        for target in (*way, *[angle] * math.ceil(_SETTLED / _FEEDING)):
            self._rig.act(np.array([target]))
            self._clock.sleep(_FEEDING)
        self._at = angle


def marked(image: Image, view: BoardView) -> Image:
    """(H, W, 3) an image with the board's corners drawn in."""
    shown = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    for x, y in view.points:
        cv2.circle(shown, (round(4 * x), round(4 * y)), 16, (40, 40, 230), 1, cv2.LINE_AA, 2)
    return np.asarray(shown, dtype=np.uint8)
