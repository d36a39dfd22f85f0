"""What goes wrong with cameras is named, and nothing while all is well."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from rig_bench import EYES, Bench

from testbed.bodies.morphology import load_robot
from testbed.errors import UserError
from testbed.hardware.clock import StillClock
from testbed.hardware.emulation.cameras import emulated_pair, swap
from testbed.hardware.emulation.lens import built_rig
from testbed.hardware.emulation.scenes import RobotScene
from testbed.hardware.emulation.truth import true_backdrop, true_calibration
from testbed.hardware.failures import (
    CameraBlack,
    CameraFrozen,
    CameraMissing,
    CamerasSwapped,
    CameraStalled,
    ExposureChanged,
    RigMoved,
)
from testbed.hardware.rig.stereo_rig import StereoRig
from testbed.physics import Simulation
from testbed.scenario.specs import RigSpec


@pytest.fixture(scope="module")
def shared() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.simulation.close()


@pytest.fixture
def bench(shared: Bench) -> Bench:
    return shared.renewed()


def _run_until_named(bench: Bench, rig: StereoRig, looks: int = 30) -> None:
    bench.looks(rig, 3)
    for _ in range(looks):
        bench.clock.sleep(1 / 15)
        rig.look()


def _gone(bench: Bench) -> None:
    bench.left.faults.gone = True


def _stalled(bench: Bench) -> None:
    bench.left.faults.stalled = bench.right.faults.stalled = True


def _one_stalled(bench: Bench) -> None:
    bench.right.faults.stalled = True


def _dropping_nearly_all(bench: Bench) -> None:
    bench.right.faults.dropping = 0.98


def _frozen(bench: Bench) -> None:
    bench.right.faults.frozen = True


def _black(bench: Bench) -> None:
    bench.left.faults.black = True


def _too_bright(bench: Bench) -> None:
    bench.left.faults.gain = 1.5


def _too_dark(bench: Bench) -> None:
    bench.right.faults.gain = 0.5


def _swapped(bench: Bench) -> None:
    swap(bench.left, bench.right)


def _knocked(bench: Bench) -> None:
    bench.right.faults.turned = (math.radians(1), 0.0, 0.0)


@pytest.mark.parametrize(
    ("happens", "named", "about"),
    [
        (_gone, CameraMissing, "left"),
        (_stalled, CameraStalled, "left camera.*right camera"),
        (_one_stalled, CameraStalled, "the right camera"),
        (_dropping_nearly_all, CameraStalled, "the right camera"),
        (_frozen, CameraFrozen, "right"),
        (_black, CameraBlack, "left"),
        (_too_bright, ExposureChanged, "left.*clips"),
        (_too_dark, ExposureChanged, "right.*0.50"),
        (_swapped, CamerasSwapped, "farther right"),
        (_knocked, RigMoved, "higher|lower"),
    ],
)
def test_what_goes_wrong_is_named(bench: Bench, happens, named: type[UserError], about: str) -> None:
    rig = bench.rig()
    bench.looks(rig, 10)  # all is well
    happens(bench)
    with pytest.raises(named, match=about):
        _run_until_named(bench, rig)


def test_lost_frames_are_no_failure(bench: Bench) -> None:
    bench.left.faults.dropping = bench.right.faults.dropping = 0.3
    rig = bench.rig()
    bench.looks(rig, 60)


def test_nothing_is_named_while_all_is_well() -> None:
    """Robots anywhere, in any posture, from rigs as people build them: no false alarm."""
    rng = np.random.default_rng(11)
    judged = 0
    with Simulation() as simulation:
        simulation.add("robot", load_robot("crawler"))
        pan = 0.0
        for seed in range(3):
            truth, clock = built_rig(np.random.default_rng(seed)), StillClock(100.0)
            cameras = emulated_pair(truth, RobotScene(simulation, RigSpec(), lambda: pan), clock, seed=seed)
            calibration = true_calibration(truth)
            rig = StereoRig(
                *cameras, calibration, true_backdrop(calibration, EYES, truth.sensor), clock, eyes=EYES
            )
            for _ in range(6):
                yaw, distance, aside = (
                    rng.uniform(-math.pi, math.pi),
                    rng.uniform(0.9, 1.3),
                    rng.uniform(-0.1, 0.1),
                )
                half = yaw / 2
                base = np.array([aside, distance, 0.05, 0, 0, math.sin(half), math.cos(half)])
                simulation.pose("robot", base, rng.uniform(-1, 1, 2))
                for _ in range(3):
                    clock.sleep(1 / 15)
                    rig.look()
                if rig.alignment.off_row is not None:
                    judged += 1
                    assert abs(rig.alignment.off_row) < 1.0
                    assert (rig.alignment.disparity or 0) > 20
                    rig.alignment.off_row = None
    assert judged > 8
