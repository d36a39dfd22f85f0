"""From two bent, noisy, unevenly lit pictures to what the student's eyes are said to see."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from rig_bench import DARK_BELOW, EYES, Bench

from testbed.hardware.emulation import scenes
from testbed.hardware.emulation.cameras import EmulatedCamera, developed
from testbed.hardware.emulation.lens import Lens, Mount, Sensor
from testbed.hardware.emulation.scenes import Shot
from testbed.hardware.failures import (
    CalibrationForeign,
    CalibrationStale,
)
from testbed.hardware.rig.rectification import Rectification
from testbed.hardware.rig.stereo_rig import StereoRig
from testbed.scenario.specs import RigSpec
from testbed.vision import SPHERE


@pytest.fixture(scope="module")
def shared() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.simulation.close()


@pytest.fixture
def bench(shared: Bench) -> Bench:
    return shared.renewed()


def test_shape_and_white(bench: Bench) -> None:
    seen = bench.looks(bench.rig(), 1)
    assert seen.shape == (2, 75, 100)
    assert seen.dtype == np.uint8
    assert (seen == 255).mean() > 0.8


@pytest.mark.parametrize("gain", [1.0, 1.12, 0.8])
@pytest.mark.parametrize("bearing", [-35, 30])
def test_vignetting_noise_and_gain_leave_the_outline_alone(bench: Bench, gain: float, bearing: float) -> None:
    """Held against the same rig with an ideal sensor: IoU above 0.97, and the same shades."""
    bench.pan = math.radians(bearing)
    rectification = Rectification(bench.calibration, EYES)
    bench.left.faults.gain = bench.right.faults.gain = gain
    seen = bench.looks(bench.rig(), 1)
    for eye in (0, 1):
        shot = bench.scene.snapshot()(bench.truth.lenses[eye], bench.truth.mounts[eye])
        ideal = developed(shot, Sensor(1.0, 0.0, bench.truth.sensor.blur, 0.0), np.random.default_rng(0))
        fine = rectification.rectified(eye, ideal).astype(np.float32)
        truth = np.rint(rectification.reduced(fine))
        here, there = seen[eye] < DARK_BELOW, truth < DARK_BELOW
        assert there.sum() > 150
        assert (here & there).sum() / (here | there).sum() > 0.97
        inside = cv2.erode(there.astype(np.uint8), np.ones((3, 3))) > 0
        assert abs(float(seen[eye][inside].mean()) - float(truth[inside].mean())) < 2.5


def test_a_robot_that_stands_still_stays_a_robot(bench: Bench) -> None:
    rig = bench.rig()
    first = bench.looks(rig, 1)
    later = bench.looks(rig, 40)
    assert np.abs(first.astype(int) - later).max() < 40
    assert ((first < DARK_BELOW) ^ (later < DARK_BELOW)).sum() <= 6


def test_panning_to_the_right_moves_the_picture_to_the_left(bench: Bench) -> None:
    rig = bench.rig()
    columns = []
    for degrees in (-37, -35, -33):
        bench.pan = math.radians(degrees)
        seen = bench.looks(rig, 1)
        columns.append(np.nonzero(seen[0] < DARK_BELOW)[1].mean())
    steps = np.diff(columns)
    # Off the middle of the picture a degree is a little more than in it.
    assert np.allclose(steps, -1.1 * EYES.focal * math.radians(2), atol=0.5)


def test_a_calibration_that_does_not_belong_is_refused(bench: Bench) -> None:
    old = bench.calibration.model_copy(update={"created": bench.calibration.created.replace(year=2020)})
    for calibration, named in (
        (bench.calibration.model_copy(update={"right_id": "a third"}), CalibrationForeign),
        (bench.calibration.model_copy(update={"left_id": "right", "right_id": "left"}), CalibrationForeign),
        (bench.calibration.model_copy(update={"opencv": "4.13.0"}), CalibrationForeign),
        (old, CalibrationStale),
    ):
        with pytest.raises(named):
            StereoRig(bench.left, bench.right, calibration, bench.backdrop, bench.clock, eyes=EYES)
    small = EmulatedCamera("left", Lens(), Mount((0, 0, 0)), _Small(), bench.clock)
    rig = StereoRig(small, bench.right, bench.calibration, bench.backdrop, bench.clock, eyes=EYES)
    small._developed = lambda *_: np.full((240, 320), 128, np.uint8)  # type: ignore[method-assign]
    bench.clock.sleep(0.1)
    with pytest.raises(CalibrationForeign, match="320 x 240"):
        rig.look()


@dataclasses.dataclass
class _Small:
    def snapshot(self) -> Shot:
        return lambda lens, mount: np.full((240, 320), 128, np.float32)


def test_the_picture_for_people_has_both(bench: Bench) -> None:
    rig = bench.rig()
    bench.looks(rig, 1)
    assert rig.picture().shape == (480, 1280, 3)
    assert rig.at == pytest.approx(bench.clock.now(), abs=0.04)


def test_bodies_with_meshes_are_drawn_by_bullet_in_the_same_place(bench: Bench) -> None:
    """The other renderer, asked for the same bodies, darkens the same pixels of the same bent picture."""
    lens, mount = bench.truth.lenses[0], bench.truth.mounts[0]
    by_rays = bench.scene.snapshot()(lens, mount)
    by_bullet = scenes._by_bullet(bench.simulation, RigSpec(), bench.pan, lens, mount)
    one, other = by_rays < 160, by_bullet < 160
    assert one.sum() > 5000
    # Its round parts have few facets.
    assert (one & other).sum() / (one | other).sum() > 0.93
    for here, there in zip(np.nonzero(one), np.nonzero(other), strict=True):
        assert abs(int(here.min()) - int(there.min())) <= 2
        assert abs(int(here.max()) - int(there.max())) <= 2


@pytest.mark.parametrize("eye", [0, 1])
def test_a_small_ball_is_seen_where_the_lens_projects_it(bench: Bench, eye: int) -> None:
    lens, mount, pan = bench.truth.lenses[eye], bench.truth.mounts[eye], math.radians(20)
    place = np.array([0.15, -0.08, 0.7])  # in the rig frame: right, down, ahead
    right, ahead = np.array([math.cos(pan), -math.sin(pan), 0]), np.array([math.sin(pan), math.cos(pan), 0])
    world = place[0] * right + place[2] * ahead + [0, 0, RigSpec().height - place[1]]
    solids = np.array([[SPHERE, 0.004, 0, 0, 50.0]])
    picture = scenes._by_rays(solids, np.array([[*world, 0, 0, 0, 1.0]]), RigSpec(), pan, lens, mount)
    dark = 255 - picture
    rows, columns = np.indices(dark.shape)
    seen = np.array([(dark * columns).sum(), (dark * rows).sum()]) / dark.sum()
    assert np.abs(seen - lens.project(mount.axes().T @ (place - mount.place))).max() < 0.2
