"""The backdrop is learned, kept, and believed where it belongs."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from rig_bench import EYES, Bench

from testbed.hardware.emulation.truth import true_backdrop
from testbed.hardware.failures import (
    CalibrationForeign,
    NotCalibrated,
)
from testbed.hardware.rig.backdrop import learned, load_backdrop, save_backdrop
from testbed.hardware.rig.rectification import Rectification
from testbed.vision.camera import StereoRig as StudentRig


@pytest.fixture(scope="module")
def shared() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.simulation.close()


@pytest.fixture
def bench(shared: Bench) -> Bench:
    return shared.renewed()


def test_the_backdrop_is_learned_while_robots_pass_by(bench: Bench) -> None:
    rectification = Rectification(bench.calibration, EYES)
    pairs = []
    for k, pan in enumerate(np.linspace(-math.pi / 2, math.pi / 2, 25)):
        bench.pan = float(pan)
        bench.clock.sleep(0.1)
        bench.left.faults.gain = 1.1 if k % 3 else 0.95  # a lamp that flickers
        frames = bench.left.newest(), bench.right.newest()
        left, right = (rectification.rectified(eye, frame.image) for eye, frame in enumerate(frames) if frame)
        pairs.append((left, right))
    found = learned(pairs, bench.calibration, EYES)
    share = found.images / bench.backdrop.images
    assert np.abs(share / np.median(share, axis=(1, 2), keepdims=True) - 1).max() < 0.02
    with pytest.raises(NotCalibrated, match="too few"):
        learned(pairs[:5], bench.calibration, EYES)
    with pytest.raises(NotCalibrated, match="not plain"):
        learned([pairs[8]] * 20, bench.calibration, EYES)
    dim = [(left // 3, right // 3) for left, right in pairs]
    with pytest.raises(NotCalibrated, match="too dark"):
        learned(dim, bench.calibration, EYES)


def test_the_backdrop_is_kept_and_refused_where_it_does_not_belong(bench: Bench, tmp_path) -> None:
    with pytest.raises(NotCalibrated):
        load_backdrop(tmp_path)
    save_backdrop(bench.backdrop, tmp_path)
    again = load_backdrop(tmp_path)
    assert np.allclose(again.images, bench.backdrop.images, rtol=1e-3)
    again.require(bench.calibration)
    other = bench.calibration.model_copy(update={"left_id": "another"})
    with pytest.raises(CalibrationForeign, match="another stereo calibration"):
        again.require(other)
    file = tmp_path / "backdrop.npz"
    file.write_bytes(file.read_bytes()[:1000])
    with pytest.raises(CalibrationForeign, match="damaged"):
        load_backdrop(tmp_path)


def test_a_backdrop_serves_every_rig_that_sees_no_more_of_it(bench: Bench) -> None:
    narrow = StudentRig(field_of_view=math.radians(35), baseline=EYES.baseline)
    learned_so = true_backdrop(bench.calibration, narrow, bench.truth.sensor)
    shown = bench.backdrop.seen_by(narrow)
    assert shown.field_of_view == narrow.field_of_view
    assert np.abs(shown.images / learned_so.images - 1).max() < 0.01
    assert np.abs(bench.backdrop.images / learned_so.images - 1).max() > 0.05
    assert bench.backdrop.seen_by(EYES) is bench.backdrop
    with pytest.raises(
        CalibrationForeign, match="view of 35 degrees, the scenario's is 50; name the scenario"
    ):
        shown.seen_by(EYES)
