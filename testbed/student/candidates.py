"""Whom the student found: what it saw of a candidate, who else was in the way, and what each mind made of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from testbed.student.candidates_depth import Depths, PartingParameters, depths_of
from testbed.student.candidates_parting import Parted, bearing_of, body_at
from testbed.student.mind import Judgement
from testbed.student.motion import Watched
from testbed.student.senses import Observation
from testbed.vision.camera import StereoRig
from testbed.vision.foreground import is_ahead, without_others

Images = NDArray[np.uint8]

_WORTH_SAYING = 0.1  # of the images: who was in the way less often is not mentioned
_AHEAD = math.radians(10)  # who stands so near to the middle of the view is looked at


@dataclass(frozen=True)
class Candidate:
    """Somebody whom the student found, and what it made of it.

    Attributes:
        bearing: Where the student saw it, rad, positive to the right.
        look_steps: (frames,) the student's action count when it took each frame.
        watched: The frames.
        judgements: What each mind made of it, by name.
        crowded: In which share of the images somebody else's outline ran into its own.
        hidden: In which share of the images somebody nearer, who was told apart by that, stood before it.
        several: How clearly it lies at two distances although it was not parted, 0 to 1.
        distance: How far away it is, m; only of those who were told apart by that.
    """

    bearing: float
    look_steps: tuple[int, ...]
    watched: Watched
    judgements: Mapping[str, Judgement]
    crowded: float = 0.0
    hidden: float = 0.0
    several: float = 0.0
    distance: float | None = None

    def judged(self, judgements: Mapping[str, Judgement], parameters: PartingParameters) -> Candidate:
        """The same with what more minds made of it; whoever says why also says what it could not see."""
        words = self._reservations(parameters)
        return replace(
            self,
            judgements={
                **self.judgements,
                **{
                    name: replace(judgement, verdict=judgement.verdict.but(words))
                    for name, judgement in judgements.items()
                },
            },
        )

    def _reservations(self, parameters: PartingParameters) -> str:
        said = []
        if self.hidden >= _WORTH_SAYING:
            said.append(f"somebody nearer stood before it in {self.hidden:.0%} of what I saw")
        elif self.crowded >= _WORTH_SAYING:
            said.append(f"in {self.crowded:.0%} of what I saw another outline ran into its own")
        if self.several >= parameters.doubtful:
            said.append("more than one body may stand here, for I saw it at two distances")
        return " and ".join(said)


@dataclass(frozen=True)
class Body:
    """One of two bodies in one outline.

    Attributes:
        offset: Its direction from the middle of the view in which it was found, rad.
        near: Whether it is the nearer one.
        depths: At which distances the two are.
    """

    offset: float
    near: bool
    depths: Depths


class Sight:
    """How the student tells candidates apart in what it sees.

    Args:
        rig: Its cameras.
        dark_below: Luminosity below which a pixel is foreground.
        parameters: When an outline is taken for two bodies.
    """

    def __init__(self, rig: StereoRig, dark_below: int, parameters: PartingParameters | None = None) -> None:
        self._rig, self._dark_below = rig, dark_below
        self.parameters = parameters or PartingParameters()

    def alone(self, seen: Candidate, others: Sequence[float]) -> Candidate:
        """Without the others, who stand at these bearings (rad)."""
        offsets = [math.remainder(other - seen.bearing, math.tau) for other in others]
        kept = without_others(seen.watched.frames, self._rig, offsets, dark_below=self._dark_below)
        watched = Watched(kept.frames, seen.watched.times)
        return replace(seen, watched=watched, crowded=float(kept.touched.mean()))

    def parted(self, seen: Candidate) -> tuple[Candidate, tuple[Body, ...]]:
        """The two bodies in an outline, from left to right, none if it is one; and how clear that is."""
        depths = depths_of(seen.watched.frames, self._rig, self._dark_below, self.parameters)
        bodies = []
        for near in (True, False) if depths.clearness >= self.parameters.clear else ():
            frames, *_ = self._body(seen.watched.frames, depths, near=near)
            offset = bearing_of(frames, self._rig, self._dark_below)
            bodies += [] if offset is None else [Body(offset, near, depths)]
        if len(bodies) < 2:
            return replace(seen, several=depths.clearness), ()
        return seen, tuple(sorted(bodies, key=lambda body: body.offset))

    def only(self, seen: Candidate, body: Body) -> Candidate:
        """One of two bodies without the other, in a film in which both may be seen; a third may be left."""
        frames, touched, unseen = self._body(seen.watched.frames, body.depths, near=body.near)
        shift = body.depths.near if body.near else body.depths.far
        return replace(
            seen,
            watched=Watched(frames, seen.watched.times, unseen),
            crowded=max(seen.crowded, float(touched.mean())),
            hidden=0.0 if body.near else float(touched.mean()),
            several=depths_of(frames, self._rig, self._dark_below, self.parameters).clearness,
            distance=self._rig.focal * self._rig.baseline / shift,
        )

    def somebody_ahead(self, observation: Observation) -> bool:
        """Whether somebody stands where the rig looks."""
        views = [observation["left"], observation["right"]]
        return any(is_ahead(view, self._rig, _AHEAD, dark_below=self._dark_below) for view in views)

    def _body(self, frames: Images, depths: Depths, *, near: bool) -> Parted:
        return body_at(frames, self._rig, depths, self._dark_below, self.parameters, near=near)


def choose(judgements: Sequence[Judgement]) -> int | None:
    """The appropriate candidate with the highest score; None if nobody is appropriate."""
    like_me = [i for i, judgement in enumerate(judgements) if judgement.verdict.answer == "appropriate"]
    return max(like_me, key=lambda i: judgements[i].verdict.score, default=None)
