"""From two bent, noisy, unevenly lit pictures to what the student's eyes are said to see, or to a named failure."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from testbed.errors import UserError
from testbed.hardware.backdrop import learned, load_backdrop, save_backdrop
from testbed.hardware.emulation import scenes
from testbed.hardware.emulation.cameras import EmulatedCamera, developed, emulated_pair, swap
from testbed.hardware.emulation.lens import Lens, Mount, RigTruth, Sensor, built_rig
from testbed.hardware.emulation.scenes import RobotScene, Shot
from testbed.hardware.emulation.truth import true_backdrop, true_calibration
from testbed.hardware.failures import (
    CalibrationForeign,
    CalibrationStale,
    CameraBlack,
    CameraFrozen,
    CameraMissing,
    CamerasSwapped,
    CameraStalled,
    ExposureChanged,
    NotCalibrated,
    RigMoved,
)
from testbed.hardware.rectification import Rectification, frame_of
from testbed.hardware.stereo_rig import StereoRig
from testbed.morphology import load_robot
from testbed.physics import Simulation
from testbed.scenario_specs import RigSpec
from testbed.vision import SPHERE
from testbed.vision.camera import StereoRig as StudentRig

EYES = StudentRig()
DARK_BELOW = 180


class Clock:
    def __init__(self) -> None:
        self.time = 100.0

    def now(self) -> float:
        return self.time

    def sleep(self, seconds: float) -> None:
        self.time += seconds

    def wait(self, port: object, deadline: float) -> bool:
        raise NotImplementedError


class Bench:
    """Three robots around a rig that turns."""

    def __init__(self, rig: RigTruth | None = None) -> None:
        self.simulation = Simulation()
        self.pan = 0.0
        for name, bearing, distance, yaw in (
            ("a", -35, 0.85, 25),
            ("b", 30, 0.95, -30),
            ("c", 85, 0.8, -80),
        ):
            place = (
                distance * math.sin(math.radians(bearing)) - 0.2 * math.cos(math.radians(yaw)),
                distance * math.cos(math.radians(bearing)) - 0.2 * math.sin(math.radians(yaw)),
            )
            self.simulation.add(name, load_robot("crawler"), place=place, yaw=math.radians(yaw))
            self.simulation.command(name, np.array([0.7, -0.5]))
        self.simulation.step(100)
        self.clock = Clock()
        self.truth = rig or built_rig(np.random.default_rng(5))
        self.scene = RobotScene(self.simulation, RigSpec(), lambda: self.pan)
        self.left, self.right = emulated_pair(self.truth, self.scene, self.clock)
        self.calibration = true_calibration(self.truth)
        self.backdrop = true_backdrop(self.calibration, EYES, self.truth.sensor)

    def rig(self) -> StereoRig:
        return StereoRig(self.left, self.right, self.calibration, self.backdrop, self.clock, eyes=EYES)

    def looks(self, rig: StereoRig, count: int) -> NDArray[np.uint8]:
        for _ in range(count):
            self.clock.sleep(1 / 15)
            seen = rig.look()
        return seen


@pytest.fixture(scope="module")
def shared() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.simulation.close()


@pytest.fixture
def bench(shared: Bench) -> Bench:
    """The shared world with cameras that nothing is wrong with."""
    shared.pan, shared.clock = math.radians(-35), Clock()
    shared.left, shared.right = emulated_pair(shared.truth, shared.scene, shared.clock)
    return shared


@settings(max_examples=40, deadline=None)
@given(
    u=st.floats(0.05, 0.95),
    v=st.floats(0.05, 0.95),
    depth=st.floats(0.3, 3.0),
    seed=st.integers(0, 7),
)
def test_a_point_lands_in_the_pixel_that_the_students_rig_says(
    u: float, v: float, depth: float, seed: int
) -> None:
    """Through a bent lens, onto the sensor, and back by the rectification's maps; each step from the other side."""
    rig, rectification = _rectified(seed)
    column, row = u * EYES.width - 0.5, v * EYES.height - 0.5
    # Where the student's left eye believes a thing to be that it sees there.
    slope = np.array(
        [(column + 0.5 - EYES.width / 2) / EYES.focal, (row + 0.5 - EYES.height / 2) / EYES.focal]
    )
    point = np.array([slope[0] * depth + EYES.eyes[0], slope[1] * depth, depth])
    axes, origin = frame_of(true_calibration(rig))
    own = axes.T @ point + origin  # in the left camera's frame
    world = rig.mounts[0].axes() @ own + rig.mounts[0].place
    wanted = EYES.project(point)[:, 0]
    for eye, (lens, mount) in enumerate(zip(rig.lenses, rig.mounts, strict=True)):
        pixel = lens.project(mount.axes().T @ (world - mount.place))
        u_map, v_map = rectification.sources(eye)
        off = np.hypot(u_map - pixel[0], v_map - pixel[1])
        best_row, best_column = np.unravel_index(int(np.argmin(off)), off.shape)
        if not (0 < best_row < off.shape[0] - 1 and 0 < best_column < off.shape[1] - 1):
            continue  # outside this eye's picture
        # How the sources change from one fine pixel to the next, across and down.
        around = np.array(
            [
                [
                    (m[best_row, best_column + 1] - m[best_row, best_column - 1]) / 2,
                    (m[best_row + 1, best_column] - m[best_row - 1, best_column]) / 2,
                ]
                for m in (u_map, v_map)
            ]
        )
        rest = pixel - (u_map[best_row, best_column], v_map[best_row, best_column])
        fine = np.array([best_column, best_row]) + np.linalg.solve(around, rest)
        found = (fine + 0.5) / 6 - 0.5
        slack = (
            abs(rig.baseline / EYES.baseline - 1) * EYES.focal * EYES.baseline / depth
        )  # cannot be computed away
        assert np.all(np.abs(found - wanted[eye]) < 0.03 + slack), (found, wanted[eye])


_RECTIFIED: dict[int, tuple[RigTruth, Rectification]] = {}


def _rectified(seed: int) -> tuple[RigTruth, Rectification]:
    if seed not in _RECTIFIED:
        rig = built_rig(np.random.default_rng(seed))
        _RECTIFIED[seed] = rig, Rectification(true_calibration(rig), EYES)
    return _RECTIFIED[seed]


def test_a_rig_that_is_built_as_it_should_be_looks_where_the_scenario_says() -> None:
    rig = RigTruth(lenses=(Lens(distortion=(-0.1, 0.03, 0.0, 0.0, 0.0)), Lens()))
    axes, origin = frame_of(true_calibration(rig))
    assert np.allclose(axes, np.eye(3), atol=1e-12)
    assert np.allclose(origin, [0.05, 0, 0])


def test_a_rig_that_looks_down_is_computed_level() -> None:
    down = math.radians(2)  # a positive turn about x, to the right, tips the axis ahead up
    mounts = (Mount((-0.05, 0, 0), (-down, 0, 0)), Mount((0.05, 0, 0), (-down, 0, 0)))
    calibration = true_calibration(RigTruth(mounts=mounts))
    assert calibration.pitch == pytest.approx(down)
    axes, _ = frame_of(calibration)
    assert np.allclose(axes @ mounts[0].axes().T, np.eye(3), atol=1e-9)


def test_cameras_that_cannot_be_the_rig_are_refused_with_what_to_write() -> None:
    calibration = true_calibration(RigTruth())
    with pytest.raises(UserError, match=r"rig: \{baseline: 0\.1000\}"):
        Rectification(calibration, StudentRig(baseline=0.12))
    with pytest.raises(UserError, match=r"rig: \{field_of_view_deg: 5\d\}") as refused:
        Rectification(calibration, StudentRig(field_of_view=math.radians(70)))
    widest = int(str(refused.value).split("field_of_view_deg: ")[1][:2])
    Rectification(calibration, StudentRig(field_of_view=math.radians(widest)))


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
    again.require(bench.calibration, EYES)
    other = bench.calibration.model_copy(update={"left_id": "another"})
    with pytest.raises(CalibrationForeign, match="another stereo calibration"):
        again.require(other, EYES)
    with pytest.raises(CalibrationForeign, match="field of view"):
        again.require(bench.calibration, StudentRig(field_of_view=math.radians(45)))
    file = tmp_path / "backdrop.npz"
    file.write_bytes(file.read_bytes()[:1000])
    with pytest.raises(CalibrationForeign, match="damaged"):
        load_backdrop(tmp_path)


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
            truth, clock = built_rig(np.random.default_rng(seed)), Clock()
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
