"""Calibrating the cameras, step by step: the board in many places, then upright, then a look around without it."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from testbed.hardware.calibration.charuco import BoardDetector, BoardView, CharucoSpec, Image, grey
from testbed.hardware.calibration.coverage import Coverage, Wish, upright
from testbed.hardware.calibration.rig import RigCalibration, calibrate_rig
from testbed.hardware.calibration.rig_fit import BoardPair
from testbed.hardware.clock import Clock
from testbed.hardware.failures import NotCalibrated
from testbed.hardware.prompt import Prompt, Question
from testbed.hardware.rig.backdrop import FEWEST_FRAMES, Backdrop, learned
from testbed.hardware.rig.cameras import Camera
from testbed.hardware.rig.pairing import Pairing
from testbed.hardware.rig.rectification import Rectification
from testbed.vision.camera import StereoRig

PAIRS = 25
"""Image pairs: with as many the baseline came out within 0.05 mm on each of 30 emulated rigs."""
MOST_TRIES = 70
STILL = 1.0
"""Pixels that corners may move between two frames: a board that moves is in two places for the two cameras."""
_PATIENCE = 3.0  # s for a board to be found and to be still
_STOPS = 25
_LEVELLING = 8  # looks at the upright board: a twentieth of a pixel tilts it by as many degrees

Seen = Callable[[Image, Image, BoardPair, int, int], None]
"""Told of each pair that is taken: the images, what was found in them, how many there are and are wanted."""


def unseen(left: Image, right: Image, pair: BoardPair, done: int, total: int) -> None:
    """Shows nothing."""


@dataclass(frozen=True)
class BoardWatcher:
    """Looks for the board with both cameras.

    Attributes:
        left: The left camera.
        right: The right camera.
        clock: The bench's.
        board: As printed.
    """

    left: Camera
    right: Camera
    clock: Clock
    board: CharucoSpec

    def size(self) -> tuple[int, int]:
        """Width and height of the images.

        Raises:
            NotCalibrated: If they differ.
        """
        sizes = [frame.image.shape[1::-1] for frame in Pairing(self.left, self.right, self.clock).newest()]
        if sizes[0] != sizes[1]:
            raise NotCalibrated("the two cameras give images of different sizes", "set both to 640 x 480")
        return int(sizes[0][0]), int(sizes[0][1])

    def still(self, looks: int = 2) -> tuple[Image, Image, BoardPair] | None:
        """A pair of images in which the board is at rest, and the board in them; None if there is none for 3 s.

        What is found is the mean of so many looks at it: each has noise of its own.
        """
        detector, pairing = BoardDetector(self.board), Pairing(self.left, self.right, self.clock)
        until = self.clock.now() + _PATIENCE
        last = None
        seen: list[BoardPair] = []
        while self.clock.now() < until:
            pair = pairing.newest()
            if pair is last:
                self.clock.sleep(0.02)
                continue
            last = pair
            images = [grey(frame.image) for frame in pair]
            found = BoardPair(*(detector.find(image) for image in images))
            if found.common() is None:
                seen = []
            else:
                seen = [*seen, found] if seen and _moved(seen[0], found) < STILL else [found]
            if len(seen) == looks:
                return images[0], images[1], _mean(seen)
            self.clock.sleep(0.1)
        return None


def calibrate_stereo(
    watcher: BoardWatcher,
    prompt: Prompt,
    *,
    measured_baseline: float | None,
    pairs: int = PAIRS,
    seen: Seen = unseen,
) -> RigCalibration:
    """Guide somebody with a board through the calibration.

    Args:
        watcher: The cameras and the board.
        prompt: Asks somebody to hold the board; see :class:`~testbed.hardware.calibration.coverage.Wish` for the
            details.
        measured_baseline: Between the lenses, by tape measure, m; None leaves that gate out.
        pairs: How many image pairs at least.
        seen: Told of each.

    Raises:
        NotCalibrated: If the board is not seen where it should be, or the result is not good enough.
    """
    size = watcher.size()
    coverage, taken = Coverage(watcher.board, size), list[BoardPair]()
    for _ in range(MOST_TRIES):
        if len(taken) >= pairs and not coverage.missing():
            break
        found = _shown(watcher, prompt, coverage.wish())
        if found is not None:
            taken.append(found[2])
            coverage.add(found[2])
            seen(*found, len(taken), pairs)
    else:
        missing = coverage.missing() or [f"{pairs - len(taken)} more pairs"]
        what = f"after {MOST_TRIES} tries there is still missing: {'; '.join(missing[:3])}"
        raise NotCalibrated(what, "more light, a flatter board, or hold it more still")
    level = _shown(watcher, prompt, upright(), looks=_LEVELLING)
    if level is None:
        what, mend = (
            "the upright board was not seen by both cameras",
            "stand it where both see it, and run again",
        )
        raise NotCalibrated(what, mend)
    return calibrate_rig(
        taken,
        watcher.board,
        size,
        left_id=watcher.left.id,
        right_id=watcher.right.id,
        measured_baseline=measured_baseline,
        upright=level[2],
    )


def learn_backdrop(
    watcher: BoardWatcher,
    calibration: RigCalibration,
    eyes: StereoRig,
    turn_to: Callable[[float], None],
    pan_limit: float,
    stops: int = _STOPS,
) -> Backdrop:
    """Learn the backdrop while the rig looks around.

    Args:
        watcher: The cameras.
        calibration: Theirs.
        eyes: The student's rig.
        turn_to: Turns the rig to a direction (rad) and returns when it is there.
        pan_limit: How far to either side, rad.
        stops: How many directions; at least 15.

    Raises:
        NotCalibrated: If the backdrop is not plain, too bright or too dark.
    """
    rectification = Rectification(calibration, eyes)
    pairing = Pairing(watcher.left, watcher.right, watcher.clock)
    frames = []
    try:
        for angle in np.linspace(-pan_limit, pan_limit, max(stops, FEWEST_FRAMES)).tolist():
            turn_to(angle)
            watcher.clock.sleep(0.15)  # so that the frames that come were exposed at rest
            pair = pairing.newest()
            left, right = (rectification.rectified(eye, grey(frame.image)) for eye, frame in enumerate(pair))
            frames.append((left, right))
    finally:
        turn_to(0.0)
    return learned(frames, calibration, eyes)


def _shown(
    watcher: BoardWatcher, prompt: Prompt, wish: Wish, looks: int = 2
) -> tuple[Image, Image, BoardPair] | None:
    prompt(Question("board", "rig", f"{wish.text} Then press Enter.", wish.details))
    found = watcher.still(looks)
    return found if found is not None and found[2].common() is not None else None


def _mean(looks: Sequence[BoardPair]) -> BoardPair:
    """The corners that are in all looks, in the middle of where they were."""
    return BoardPair(_mean_view([look.left for look in looks]), _mean_view([look.right for look in looks]))


def _mean_view(views: Sequence[BoardView | None]) -> BoardView:
    there = [view for view in views if view is not None]
    ids = functools.reduce(np.intersect1d, [view.ids for view in there])
    return BoardView(ids, np.mean([view.only(ids).points for view in there], axis=0))


def _moved(before: BoardPair, now: BoardPair) -> float:
    """How far (pixels) the corners have moved at most, in either image; infinite if none is in both."""
    farthest = 0.0
    for old, new in ((before.left, now.left), (before.right, now.right)):
        if old is None or new is None:
            return math.inf
        ids = np.intersect1d(old.ids, new.ids)
        if not len(ids):
            return math.inf
        farthest = max(farthest, float(np.abs(old.only(ids).points - new.only(ids).points).max()))
    return farthest
