"""From a body plan and a film to numbers: how large, how far, which way and in which pose (extension of Section 3.3.2).

A fit begins in a few key frames: poses from nothing with lengths free in each frame, their medians shared by all,
poses anew, then everything together. The other frames start from the poses of their neighbours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from testbed.bodies.morphology import Vector
from testbed.student.motion import Watched
from testbed.student.parameters import FittingParameters
from testbed.student.seeing._plan import Eyes
from testbed.student.seeing.articulated import Body, Indices, eyes_of
from testbed.student.seeing.bundling import Fit, Prior, bundle, score, settle_poses
from testbed.student.seeing.posing import best_few, depth_of, pose_from_nothing
from testbed.vision.camera import StereoRig
from testbed.vision.silhouette import darkness


@dataclass(frozen=True)
class Film:
    """A candidate as the fits take it.

    Attributes:
        eyes: Darkness (F, 2, height, width) and the rig.
        times: (F,) s.
        keys: Key frames.
        depth: By disparity, m.
        area: Mean area of the silhouette at that depth, m2.
    """

    eyes: Eyes
    times: Vector
    keys: Indices
    depth: float
    area: float

    @property
    def pixel(self) -> float:
        """Size of a pixel at the candidate's depth, m."""
        return self.depth / float(self.eyes.camera[0])


def film_of(watched: Watched, rig: StereoRig, parameters: FittingParameters) -> Film:
    """Darkness, depth and key frames of what was watched."""
    alpha = darkness(watched.frames, parameters.silhouette)
    if watched.unseen is not None:
        alpha[watched.unseen] = 0
    eyes = eyes_of(alpha, rig, watched.unseen)
    count = len(alpha)
    keys = np.unique(np.linspace(0, count - 1, min(parameters.key_frames, count)).round().astype(np.int64))
    depth = depth_of(alpha, rig)
    area = float(alpha.sum((2, 3)).mean()) * (depth / rig.focal) ** 2
    return Film(eyes, np.asarray(watched.times, float), keys, depth, area)


def prior_of(body: Body, film: Film, parameters: FittingParameters) -> Prior:
    """What is expected of a body's shared numbers before it is laid into the film."""
    spread = {
        "scale": parameters.scale_sd,
        "depth": parameters.depth_share * film.depth,
        "yaw": math.radians(parameters.yaw_sd_deg),
        "length": parameters.length_sd,
        "thickness": parameters.thickness_sd,
        "turn": math.inf,
    }
    yaw = math.radians(parameters.yaw_limit_deg)
    limits = {
        "depth": (0.5 * film.depth, 2 * film.depth),
        "yaw": (-yaw, yaw),
        "length": tuple(np.log(parameters.length_limits)),
        "thickness": tuple(np.log(parameters.thickness_limits)),
    }
    names = body.names[body.pose :]
    return Prior(
        mean=np.array([film.depth if name == "depth" else 0.0 for name in names]),
        precision=np.array([parameters.noise / spread[name] ** 2 for name in names]),
        low=np.array([limits.get(name, (-np.inf, np.inf))[0] for name in names]),
        high=np.array([limits.get(name, (-np.inf, np.inf))[1] for name in names]),
    )


def side_area(body: Body) -> float:
    """Area (m2) of the silhouette of a body at scale one, seen from the side without overlaps."""
    area = 0.0
    for limb in body.limbs:
        part = limb.part
        if part.shape == "cuboid":
            area += part.size[0] * (part.size[2] + 0.1 * part.size[1])  # a little of its top is seen
        elif part.shape == "sphere":
            area += math.pi * part.radius**2
        else:
            area += 2 * part.radius * part.length
    return area


def start_of(body: Body, film: Film) -> Vector:
    """(q,) shared numbers to begin with: the size from the area, the depth from the disparity."""
    shared = np.zeros(body.shared)
    shared[body.plan.common[0] - body.pose] = 0.5 * math.log(max(film.area, 1e-9) / side_area(body))
    shared[body.plan.common[1] - body.pose] = film.depth
    return shared


def rough_fit(body: Body, film: Film, shared: Vector, parameters: FittingParameters) -> Fit:
    """The first round: poses from nothing in the key frames, sizes free in each, then their medians for all."""
    eyes = film.eyes
    which, x, cost = pose_from_nothing(body, eyes, film.keys, shared, parameters.posing, parameters.lengths)
    few = best_few(which, cost, parameters.loose_best)
    loose = {"scale": parameters.noise / 0.06**2, "length": parameters.noise / parameters.length_sd**2}
    x, cost = settle_poses(body, eyes, which[few], x[few], iterations=8, loose=loose)
    best = best_few(which[few], cost, 1)
    x = x[best]
    shared = np.median(x[:, body.pose :], axis=0)
    x[:, body.pose :] = shared
    cost = score(body, eyes, film.keys, x)
    return Fit(body, film.keys, x[:, : body.pose], shared, cost, eyes.blank[film.keys])


def refined(fit: Fit, film: Film, parameters: FittingParameters, *, rounds: int | None = None) -> Fit:
    """Later rounds: everything together with plane and depth kept, poses from nothing again, then all free."""
    body, eyes = fit.body, film.eyes
    prior = prior_of(body, film, parameters)
    kept = prior.held(body, "yaw", "depth")
    fit = bundle(fit, eyes, kept, iterations=parameters.iterations)
    for _ in range((parameters.rounds if rounds is None else rounds) - 1):
        which, x, cost = pose_from_nothing(
            body, eyes, fit.frames, fit.shared, parameters.posing, overturned=True
        )
        best = best_few(which, cost, 1)
        again = cost[best] < fit.cost
        poses = np.where(again[:, None], x[best][:, : body.pose], fit.poses)
        fit = Fit(body, fit.frames, poses, fit.shared, np.where(again, cost[best], fit.cost), fit.blank)
        fit = bundle(fit, eyes, kept, iterations=parameters.iterations)
    return bundle(fit, eyes, prior, iterations=parameters.iterations)


def fit_body(body: Body, film: Film, parameters: FittingParameters) -> Fit:
    """A body laid into the key frames, facing the way that suits better."""
    shared = start_of(body, film)
    both = [rough_fit(way, film, shared, parameters) for way in (body, body.facing_other_way())]
    return refined(min(both, key=lambda fit: fit.cost.sum()), film, parameters)


def followed(fit: Fit, film: Film, parameters: FittingParameters) -> Fit:
    """The fit of the key frames carried to every frame: from the nearest key frames, then from the neighbours."""
    body, eyes = fit.body, film.eyes
    count = len(film.times)
    frames = np.arange(count)
    poses = np.stack([np.interp(frames, fit.frames, column) for column in fit.poses.T], axis=1)
    left = np.clip(np.searchsorted(fit.frames, frames, side="right") - 1, 0, len(fit.frames) - 1)
    right = np.clip(np.searchsorted(fit.frames, frames), 0, len(fit.frames) - 1)
    starts = np.concatenate([poses, fit.poses[left], fit.poses[right]])
    which = np.tile(frames, 3)
    x, cost = _settled(body, eyes, which, starts, fit.shared)
    for turn in range(3):
        best = best_few(which, cost, 1)
        x, cost = x[best], cost[best]
        sources = np.concatenate([np.maximum(frames - 1, 0), np.minimum(frames + 1, count - 1)])
        others = np.tile(frames, 2)
        more, more_cost = _settled(body, eyes, others, x[sources, : body.pose], fit.shared)
        which = np.concatenate([frames, others])
        x, cost = np.concatenate([x, more]), np.concatenate([cost, more_cost])
        if turn == 0:
            which, x, cost = _found_again(fit, film, which, x, cost, parameters)
    best = best_few(which, cost, 1)
    whole = Fit(body, frames, x[best][:, : body.pose], fit.shared, cost[best], eyes.blank)
    return bundle(whole, eyes, prior_of(body, film, parameters), iterations=6)


def _found_again(
    fit: Fit, film: Film, which: Indices, x: Vector, cost: Vector, parameters: FittingParameters
) -> tuple[Indices, Vector, Vector]:
    """Poses from nothing for the frames that are explained clearly worse than the key frames."""
    blank = np.maximum(film.eyes.blank, 1e-9)
    best = best_few(which, cost, 1)
    share = cost[best] / blank[which[best]]
    limit = parameters.lost * float(np.median(fit.cost / np.maximum(fit.blank, 1e-9))) + 0.01
    lost = which[best][share > limit]
    if not lost.size:
        return which, x, cost
    more, more_x, more_cost = pose_from_nothing(
        fit.body, film.eyes, lost, fit.shared, parameters.posing, overturned=True
    )
    few = best_few(more, more_cost, 1)
    return (
        np.concatenate([which, more[few]]),
        np.concatenate([x, more_x[few]]),
        np.concatenate([cost, more_cost[few]]),
    )


def _settled(body: Body, eyes: Eyes, which: Indices, poses: Vector, shared: Vector) -> tuple[Vector, Vector]:
    x = np.hstack([poses, np.tile(shared, (len(poses), 1))])
    return settle_poses(body, eyes, which, x, iterations=6)
