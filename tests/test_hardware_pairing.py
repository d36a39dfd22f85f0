"""Which frames belong together, and which do not count as seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from testbed.hardware.clock import StillClock
from testbed.hardware.emulation.cameras import EmulatedCamera, emulated_pair
from testbed.hardware.emulation.lens import SIZE, Lens, Mount, RigTruth
from testbed.hardware.emulation.scenes import Picture, Shot
from testbed.hardware.failures import (
    CameraBlack,
    CameraFrozen,
    CamerasApart,
    CameraStalled,
)
from testbed.hardware.rig.cameras import Frame
from testbed.hardware.rig.pairing import Pairing, PairingSpec


class Wall:
    """A plain grey wall."""

    def snapshot(self) -> Shot:
        def seen(lens: Lens, mount: Mount) -> Picture:
            return np.full((SIZE[1], SIZE[0]), 180, np.float32)

        return seen


def cameras(clock: StillClock, phase: float = 0.004) -> tuple[EmulatedCamera, EmulatedCamera]:
    left, right = emulated_pair(RigTruth(), Wall(), clock)
    right._start = clock.now() + phase
    return left, right


def follow(pairing: Pairing, clock: StillClock, seconds: float, step: float = 1 / 60) -> list[float]:
    """Look again and again; how far apart (s) the frames of each pair were."""
    gaps, last = [], None
    for _ in range(round(seconds / step)):
        clock.sleep(step)
        for camera in pairing.cameras:
            if isinstance(camera, EmulatedCamera):
                camera.expose()
        pair = pairing.newest()
        if pair is not last:
            gaps.append(abs(pair.left.at - pair.right.at))
        last = pair
    return gaps


@settings(max_examples=6, deadline=None)
@given(phase=st.floats(0, 1 / 30), drops=st.floats(0, 0.4))
def test_pairs_are_never_further_apart_than_said(phase: float, drops: float) -> None:
    clock = StillClock(5.0)
    left, right = cameras(clock, phase)
    left.faults.dropping = right.faults.dropping = drops
    gaps = follow(Pairing(left, right, clock, PairingSpec(patience=1.0)), clock, 1.0)
    assert max(gaps) <= 0.017
    assert len(gaps) > (12 if drops < 0.2 else 4)


def test_after_lost_frames_pairs_are_as_near_as_before() -> None:
    clock = StillClock(5.0)
    left, right = cameras(clock)
    pairing = Pairing(left, right, clock)
    follow(pairing, clock, 0.5)
    right.faults.stalled = True  # two frames of one camera are lost
    follow(pairing, clock, 2 / 30)
    right.faults.stalled = False
    assert max(follow(pairing, clock, 1.0)) == pytest.approx(0.004, abs=1e-6)


def test_the_first_pair_is_waited_for() -> None:
    clock = StillClock(5.0)
    left, right = cameras(clock, 0.02)
    left._start = clock.now() + 0.2
    pair = Pairing(left, right, clock).newest()
    assert pair.at == pytest.approx(5.2, abs=0.05)


def test_no_frames_at_all_is_stalled() -> None:
    clock = StillClock(5.0)
    left, right = cameras(clock)
    left.faults.stalled = True
    with pytest.raises(CameraStalled, match="the left camera"):
        Pairing(left, right, clock).newest()


def test_clocks_that_differ_are_apart() -> None:
    clock = StillClock(5.0)
    left, right = cameras(clock)
    pairing = Pairing(left, right, clock)
    follow(pairing, clock, 0.5)
    for camera in (left, right):  # ten frames a second, and half a period apart
        camera._start, camera._rate, camera._count = clock.now() + 0.05 * (camera is right), 10.0, -1
    with pytest.raises(CamerasApart, match="17 ms"):
        follow(pairing, clock, 3.0)


def test_frozen_is_named_only_after_several_repeats() -> None:
    clock = StillClock(5.0)
    left, right = cameras(clock)
    pairing = Pairing(left, right, clock)
    follow(pairing, clock, 0.5)
    left.faults.frozen = True
    follow(pairing, clock, 2 / 30)
    left.faults.frozen = False
    follow(pairing, clock, 1.0)
    left.faults.frozen = True
    with pytest.raises(CameraFrozen, match=r"the left camera \(left\)"):
        follow(pairing, clock, 0.5)


def test_black_is_named_and_a_dark_room_is_not() -> None:
    clock = StillClock(5.0)
    left, right = cameras(clock)
    pairing = Pairing(left, right, clock)
    left.faults.gain = right.faults.gain = 0.35
    follow(pairing, clock, 0.5)
    right.faults.black = True
    with pytest.raises(CameraBlack, match="right"):
        follow(pairing, clock, 0.5)


def test_looking_seldom_is_no_failure() -> None:
    clock = StillClock(5.0)
    left, right = cameras(clock)
    pairing = Pairing(left, right, clock)
    for _ in range(5):
        clock.sleep(10.0)
        assert pairing.newest().at == pytest.approx(clock.now(), abs=0.05)


class Fixed:
    """A camera whose frames came at these times."""

    def __init__(self, name: str, times: Sequence[float]) -> None:
        rng = np.random.default_rng(0)
        image = rng.integers(100, 200, (480, 640), dtype=np.uint8)
        self.id = name
        self._frames = [Frame(image, at, number) for number, at in enumerate(times)]

    def newest(self) -> Frame | None:
        return self._frames[-1]

    def recent(self) -> Sequence[Frame]:
        return self._frames

    def settings(self) -> dict[str, float]:
        return {}

    def lock(self) -> Sequence[str]:
        return ()

    def close(self) -> None:
        pass


def test_of_all_that_fit_the_newest_are_taken() -> None:
    clock = StillClock(5.0)
    pairing = Pairing(Fixed("a", [4.90, 4.933, 4.967]), Fixed("b", [4.889, 4.922, 4.949]), clock)
    pair = pairing.newest()
    assert (pair.left.number, pair.right.number) == (1, 2)
