"""From images of the board to where the two cameras are and how their lenses bend.

The root mean square of the fit itself says little: with six pairs of images it still reads 0.08 pixels while the
rotation is a fifth of a degree off. So a share of the pairs takes no part in the fit, and what is asked is how far its
corners lie off the same row after rectification, and whether the baseline is the one that a tape measure reads.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from testbed.bodies.morphology import Vector
from testbed.hardware.calibration.charuco import BoardView, CharucoSpec
from testbed.hardware.failures import NotCalibrated

FEWEST_PAIRS = 15
"""With fewer the rotation between the cameras is not known well, whatever the fit says."""
FEWEST_CORNERS = 8
"""In a view: fewer hardly tell a tilt from a distance."""
EVERY = 5
"""Each so manieth pair is held out."""
EPIPOLAR_LIMIT = 0.25
"""Pixels of the full image, root mean square, that held-out corners may lie off their row: a 25th of the student's."""
BASELINE_TOLERANCE = 1e-3
"""How far (m) the fitted baseline may be from the measured one: as well as a tape measure is read."""
GUESS = 0.87
"""Focal length over image width of a 60 degree webcam, where the fit begins."""


@dataclass(frozen=True)
class BoardPair:
    """What the two cameras saw of the board at the same time; None where it was not found."""

    left: BoardView | None
    right: BoardView | None

    def common(self) -> tuple[BoardView, BoardView] | None:
        """The corners that both saw, or None if there are too few."""
        if self.left is None or self.right is None:
            return None
        ids = np.intersect1d(self.left.ids, self.right.ids)
        return (self.left.only(ids), self.right.only(ids)) if len(ids) >= FEWEST_CORNERS else None


@dataclass(frozen=True)
class Geometry:
    """Two cameras: from rays to pixels, and from the left camera's frame to the right one's.

    Attributes:
        matrices: (2, 3, 3) focal lengths and centres.
        distortions: (2, 5) k1, k2, p1, p2, k3.
        rotation: (3, 3) and
        translation: (3,) m: a point p of the left camera's frame is ``rotation @ p + translation`` in the right one's.
    """

    matrices: Vector
    distortions: Vector
    rotation: Vector
    translation: Vector

    @property
    def baseline(self) -> float:
        """Distance between the eyes, m."""
        return float(np.linalg.norm(self.translation))

    def rows_aligned(self) -> tuple[Vector, Vector]:
        """(3, 3) rotations from the left and the right camera's frame to a common one whose x axis joins the eyes.

        Its z axis is the mean of the optical axes, as far as that is possible.
        """
        x = -self.rotation.T @ self.translation  # the right eye in the left frame
        x = -x if x[0] < 0 else x
        x = x / np.linalg.norm(x)
        ahead = np.array([0.0, 0.0, 1.0]) + self.rotation.T @ (0.0, 0.0, 1.0)
        y = np.cross(ahead, x)
        y /= np.linalg.norm(y)
        left = np.stack([x, y, np.cross(x, y)])
        return left, left @ self.rotation.T

    def slopes(self, eye: int, points: Vector, turn: Vector) -> Vector:
        """(N, 2) slopes x / z and y / z, in a frame that is turned by ``turn`` (3, 3), of what is seen at pixels."""
        bent = np.asarray(points, dtype=np.float64).reshape(-1, 1, 2)
        straight = cv2.undistortPoints(bent, self.matrices[eye], self.distortions[eye], R=turn)
        return np.asarray(straight, dtype=np.float64).reshape(-1, 2)


@dataclass(frozen=True)
class RigFit:
    """A fitted geometry and how well it does on pairs that it was not fitted to.

    Attributes:
        geometry: The two cameras.
        epipolar: Root mean square of how far held-out corners lie off their row, pixels of the full image.
        corner_rms: Of the fit itself, pixels.
        pairs: How many pairs were fitted.
        held_out: How many were not.
    """

    geometry: Geometry
    epipolar: float
    corner_rms: float
    pairs: int
    held_out: int


def fit_rig(pairs: Sequence[BoardPair], spec: CharucoSpec, size: tuple[int, int]) -> RigFit:
    """Fit both cameras to images of the board; every fifth pair is held out.

    Args:
        pairs: What was seen, in any order of poses.
        spec: The board as it was printed.
        size: Width and height of the images.

    Raises:
        NotCalibrated: If there are too few usable pairs, or no fit.
    """
    usable = [both for pair in pairs if (both := pair.common()) is not None]
    if len(usable) < FEWEST_PAIRS:
        raise NotCalibrated(
            f"only {len(usable)} of {len(pairs)} image pairs show enough of the board to both cameras",
            f"take at least {FEWEST_PAIRS}, sharp and well lit",
        )
    fitted = [both for k, both in enumerate(usable) if k % EVERY != EVERY - 1]
    held_out = [both for k, both in enumerate(usable) if k % EVERY == EVERY - 1]
    try:
        geometry, rms = _fitted(fitted, spec, size)
    except cv2.error as error:
        raise NotCalibrated(f"the cameras cannot be fitted ({error.err})", "take the pairs anew") from error
    if not all(np.all(np.isfinite(part)) for part in (geometry.matrices, geometry.distortions, rms)):
        raise NotCalibrated("the cameras cannot be fitted", "take the pairs anew, the board tilted each way")
    return RigFit(geometry, off_row(geometry, held_out), rms, len(fitted), len(held_out))


def _fitted(
    pairs: Sequence[tuple[BoardView, BoardView]], spec: CharucoSpec, size: tuple[int, int]
) -> tuple[Geometry, float]:
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)  # with several the sums come in another order each time, and so do the last digits
    try:
        return _fitted_alone(pairs, spec, size)
    finally:
        cv2.setNumThreads(threads)


def _fitted_alone(
    pairs: Sequence[tuple[BoardView, BoardView]], spec: CharucoSpec, size: tuple[int, int]
) -> tuple[Geometry, float]:
    corners = spec.corners().astype(np.float32)
    objects = [corners[left.ids] for left, _ in pairs]
    images = [[pair[eye].points.astype(np.float32) for pair in pairs] for eye in (0, 1)]
    guess = np.array([[GUESS * size[0], 0, (size[0] - 1) / 2], [0, 0, (size[1] - 1) / 2], [0, 0, 1]])
    guess[1, 1] = guess[0, 0]
    lenses = []
    for eye in (0, 1):
        _, matrix, distortion, *_ = cv2.calibrateCamera(
            objects, images[eye], size, guess.copy(), np.zeros(5), flags=cv2.CALIB_USE_INTRINSIC_GUESS
        )
        lenses.append((matrix, np.asarray(distortion).reshape(-1)[:5]))
    (left, left_bent), (right, right_bent) = lenses
    # All is fitted once more together: what one camera sees well tells the other where the board was.
    rms, left, left_bent, right, right_bent, rotation, translation, *_ = cv2.stereoCalibrate(
        objects,
        images[0],
        images[1],
        left,
        left_bent,
        right,
        right_bent,
        size,
        flags=cv2.CALIB_USE_INTRINSIC_GUESS,
    )
    geometry = Geometry(
        np.asarray([left, right], dtype=np.float64),
        np.asarray([np.ravel(bent)[:5] for bent in (left_bent, right_bent)], dtype=np.float64),
        np.asarray(rotation, dtype=np.float64),
        np.asarray(translation, dtype=np.float64).reshape(3),
    )
    return geometry, float(rms)


def off_row(geometry: Geometry, pairs: Sequence[tuple[BoardView, BoardView]]) -> float:
    """How far corners lie off their row after rectification: root mean square, in pixels of the full image."""
    turns = geometry.rows_aligned()
    gaps = [
        geometry.slopes(0, left.points, turns[0])[:, 1] - geometry.slopes(1, right.points, turns[1])[:, 1]
        for left, right in pairs
    ]
    focal = float(geometry.matrices[:, 1, 1].mean())
    return float(np.sqrt(np.mean(np.concatenate(gaps) ** 2)) * focal)
