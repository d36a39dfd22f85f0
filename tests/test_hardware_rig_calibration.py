"""Lenses, board and calibration: what goes in is known exactly, what comes out has to be that, or is refused."""

from __future__ import annotations

import datetime
import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from testbed.bodies.morphology import Vector
from testbed.frames import rotation_about
from testbed.hardware.calibration.board_check import check_rig, pitch_of
from testbed.hardware.calibration.charuco import BoardDetector, BoardView, CharucoSpec
from testbed.hardware.calibration.coverage import Coverage
from testbed.hardware.calibration.rig import (
    RigCalibration,
    calibrate_rig,
    load_calibration,
    save_calibration,
)
from testbed.hardware.calibration.rig_fit import BoardPair, fit_rig
from testbed.hardware.calibration.rig_procedure import BoardWatcher, calibrate_stereo
from testbed.hardware.clock import StillClock
from testbed.hardware.emulation.cameras import developed, emulated_pair
from testbed.hardware.emulation.lens import Lens, Mount, RigTruth, Sensor, built_rig
from testbed.hardware.emulation.poses import held, held_about, held_as_asked
from testbed.hardware.emulation.scenes import BoardScene
from testbed.hardware.emulation.truth import true_calibration, true_geometry
from testbed.hardware.failures import CalibrationForeign, CalibrationStale, NotCalibrated, RigMoved
from testbed.hardware.prompt import Question, nothing

BOARD = CharucoSpec()
SIZE = (640, 480)


def views(truth: RigTruth, pose: Vector, rng: np.random.Generator, noise: float = 0.05) -> BoardPair:
    """What a detector with some noise finds, without rendering: corners through lenses onto sensors."""
    found = []
    for lens, mount in zip(truth.lenses, truth.mounts, strict=True):
        corners = BOARD.corners() @ pose[:3, :3].T + pose[:3, 3]
        pixels = lens.project((corners - mount.place) @ mount.axes())
        pixels += rng.normal(0, noise, pixels.shape)
        ids = np.flatnonzero(np.all((pixels > 10) & (pixels < np.array(SIZE) - 10), axis=1))
        found.append(BoardView(ids, pixels[ids]) if len(ids) >= 4 else None)
    return BoardPair(*found)


def pairs_of(truth: RigTruth, seed: int = 0, count: int = 25, noise: float = 0.05) -> list[BoardPair]:
    rng = np.random.default_rng(seed)
    return [views(truth, pose, rng, noise) for pose in held_about(BOARD, rng, count)]


def calibrated(pairs: list[BoardPair], baseline: float | None = 0.1, **more: BoardPair) -> RigCalibration:
    return calibrate_rig(
        pairs, BOARD, SIZE, left_id="left", right_id="right", measured_baseline=baseline, **more
    )


# The lens -----------------------------------------------------------------------------------------------------


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 100), u=st.floats(-20, 660), v=st.floats(-20, 500))
def test_a_lens_and_its_inverse_agree_and_agree_with_opencv(seed: int, u: float, v: float) -> None:
    lens = built_rig(np.random.default_rng(seed)).lenses[0]
    pixel = np.array([u, v])
    ray = lens.rays(pixel)
    point = np.array([*ray, 1.0]) * 0.7
    assert np.allclose(lens.project(point), pixel, atol=1e-6)
    matrix = np.array([[lens.focal[0], 0, lens.centre[0]], [0, lens.focal[1], lens.centre[1]], [0, 0, 1]])
    seen, _ = cv2.projectPoints(point, np.zeros(3), np.zeros(3), matrix, np.array(lens.distortion))
    assert np.allclose(seen.reshape(2), pixel, atol=1e-6)


@settings(max_examples=30, deadline=None)
@given(first=st.tuples(*[st.floats(-1.5, 1.5)] * 3), second=st.tuples(*[st.floats(-1.5, 1.5)] * 3))
def test_a_knock_is_a_further_turn(
    first: tuple[float, float, float], second: tuple[float, float, float]
) -> None:
    moved = Mount((0.1, 0, 0), first).moved(second)
    together = rotation_about(first)[:3, :3] @ rotation_about(second)[:3, :3]
    if np.trace(together) > -0.99:
        assert np.allclose(moved.axes(), together, atol=1e-6)


# The detector on rendered boards ------------------------------------------------------------------------------


def test_corners_of_rendered_boards_are_found_where_they_are() -> None:
    """Without bias, to a twentieth of a pixel, and none far off: the board's markers keep away from its corners."""
    rng = np.random.default_rng(3)
    truth, detector, errors = built_rig(rng), BoardDetector(BOARD), []
    lens, mount = truth.lenses[0], truth.mounts[0]
    for pose in held_about(BOARD, rng, 8):
        image = developed(BoardScene(BOARD, pose).snapshot()(lens, mount), Sensor(), rng)
        view = detector.find(image)
        assert view is not None
        corners = BOARD.corners()[view.ids] @ pose[:3, :3].T + pose[:3, 3]
        errors.append(view.points - lens.project((corners - mount.place) @ mount.axes()))
    off = np.concatenate(errors)
    assert len(off) > 150
    assert np.abs(off.mean(axis=0)).max() < 0.02
    assert np.sqrt((off**2).mean()) < 0.08
    assert np.quantile(np.linalg.norm(off, axis=1), 0.99) < 0.35


def test_no_board_is_no_view() -> None:
    rng = np.random.default_rng(0)
    assert BoardDetector(BOARD).find(rng.integers(100, 150, (480, 640), dtype=np.uint8)) is None


# The guided procedure, on rendered images ---------------------------------------------------------------------


def test_the_guided_procedure_reaches_its_aims() -> None:
    """Hands that hold the board roughly as they are asked; once they show nothing."""
    chance = np.random.default_rng(1)
    truth, clock = built_rig(chance), StillClock()
    away = np.eye(4)
    away[2, 3] = -1.0  # behind the cameras
    left, right = emulated_pair(truth, BoardScene(BOARD, away), clock)
    asked = []

    def hands(question: Question, meanwhile: Callable[[], None] = nothing) -> str:
        asked.append(question)
        pose = away if len(asked) == 3 else held_as_asked(BOARD, question.details, chance)
        left.scene = right.scene = BoardScene(BOARD, pose, supersample=3)
        clock.sleep(2.0)
        return ""

    taken = []
    found = calibrate_stereo(
        BoardWatcher(left, right, clock, BOARD),
        hands,
        measured_baseline=0.1,
        seen=lambda one, other, pair, done, total: taken.append(done),
    )
    assert taken == list(range(1, len(taken) + 1))
    assert len(asked) >= len(taken) + 2  # one showed nothing, the last is the upright board
    assert found.pairs + found.held_out == len(taken) >= 25
    assert found.epipolar < 0.25
    assert abs(found.baseline - truth.baseline) < 0.1e-3
    assert abs(found.pitch - true_calibration(truth).pitch) < math.radians(0.25)
    assert "upper far left" in asked[0].text
    assert asked[-1].details["upright"] == "yes"


def test_who_shows_no_board_is_told_what_is_missing() -> None:
    truth, clock = RigTruth(), StillClock()
    away = np.eye(4)
    away[2, 3] = -1.0
    left, right = emulated_pair(truth, BoardScene(BOARD, away, supersample=1), clock)
    coverage = Coverage(BOARD, SIZE)
    assert len(coverage.missing()) == 24 + 4 + 2
    assert BoardWatcher(left, right, clock, BOARD).still() is None


def test_a_board_that_moves_is_not_taken() -> None:
    truth, clock = RigTruth(), StillClock()
    left, right = emulated_pair(truth, _Waved(), clock)
    _Waved.phase = 0.0
    assert BoardWatcher(left, right, clock, BOARD).still() is None


class _Waved:
    """A board that somebody waves."""

    phase = 0.0

    def snapshot(self):
        _Waved.phase += 0.05
        pose = held(BOARD, u=0.2 * math.sin(5 * _Waved.phase), v=0.0, distance=0.4)
        return BoardScene(BOARD, pose, supersample=1).snapshot()


# Gates, on corners without rendering --------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_a_fit_finds_the_rig(seed: int) -> None:
    truth = built_rig(np.random.default_rng(seed))
    fit = fit_rig(pairs_of(truth, seed), BOARD, SIZE)
    true = true_geometry(truth)
    assert abs(fit.geometry.baseline - truth.baseline) < 0.15e-3
    assert fit.epipolar < 0.12
    turn = fit.geometry.rotation @ true.rotation.T
    assert math.degrees(math.acos(min(1, (np.trace(turn) - 1) / 2))) < 0.1
    assert np.allclose(fit.geometry.matrices[:, 0, 0], true.matrices[:, 0, 0], rtol=0.01)
    assert (fit.pairs, fit.held_out) == (20, 5)


def test_held_out_pairs_take_no_part_in_the_fit() -> None:
    truth = built_rig(np.random.default_rng(1))
    pairs = pairs_of(truth)
    good = fit_rig(pairs, BOARD, SIZE)
    spoilt = list(pairs)
    for k in range(4, 25, 5):
        left, right = pairs[k].left, pairs[k].right
        assert left is not None
        spoilt[k] = BoardPair(BoardView(left.ids, left.points + np.array([0, 3])), right)
    bad = fit_rig(spoilt, BOARD, SIZE)
    assert np.array_equal(good.geometry.matrices, bad.geometry.matrices)
    assert bad.epipolar > 2


def test_what_is_not_good_enough_is_refused_with_what_to_do() -> None:
    truth = built_rig(np.random.default_rng(2))
    pairs = pairs_of(truth)
    with pytest.raises(NotCalibrated, match="only 10 of 10"):
        calibrated(pairs[:10])
    with pytest.raises(NotCalibrated, match=r"mm apart, measured were 103\.0 mm"):
        calibrated(pairs, 0.103)
    with pytest.raises(NotCalibrated, match="pixels off their row"):
        calibrated(pairs_of(truth, noise=0.6))
    with pytest.raises(NotCalibrated, match="exchanged"):
        calibrated([BoardPair(pair.right, pair.left) for pair in pairs])
    nothing_seen = [BoardPair(None, pair.right) for pair in pairs]
    with pytest.raises(NotCalibrated, match="only 0 of 25"):
        calibrated(nothing_seen)


def test_few_tilts_are_missed_even_where_the_fit_looks_well() -> None:
    coverage, truth, rng = Coverage(BOARD, SIZE), RigTruth(), np.random.default_rng(0)
    for column in (-0.6, -0.2, 0.2, 0.6):
        for row in (-0.5, 0.0, 0.5):
            coverage.add(views(truth, held(BOARD, u=column, v=row, distance=0.35), rng))
    missing = coverage.missing()
    assert not any("image" in words for words in missing)
    assert {"views with the top edge toward the cameras", "views from far"} <= set(missing)


@pytest.mark.parametrize(
    ("turn", "edge"),
    [((0.5, 0, 0), "top"), ((-0.5, 0, 0), "bottom"), ((0, -0.5, 0), "left"), ((0, 0.5, 0), "right")],
)
def test_which_edge_is_nearer(turn: tuple[float, float, float], edge: str) -> None:
    coverage = Coverage(BOARD, SIZE)
    pose = held(BOARD, u=0.0, v=0.0, distance=0.4, turn=turn)
    corners = BOARD.corners() @ pose[:3, :3].T + pose[:3, 3]
    depth = corners[:, 2].reshape(BOARD.rows - 1, BOARD.columns - 1)
    edges = {"top": depth[0], "bottom": depth[-1], "left": depth[:, 0], "right": depth[:, -1]}
    assert min(edges, key=lambda name: edges[name].mean()) == edge
    coverage.add(views(RigTruth(), pose, np.random.default_rng(0)))
    assert coverage.leanings[edge] == 1


@pytest.mark.parametrize("degrees", [-2.0, 0.0, 1.5])
def test_the_upright_board_tells_where_level_is(degrees: float) -> None:
    down = math.radians(degrees)
    truth = RigTruth(mounts=(Mount((-0.05, 0, 0), (-down, 0, 0)), Mount((0.05, 0, 0), (-down, 0, 0))))
    upright = views(truth, held(BOARD, u=0.0, v=0.0, distance=0.4), np.random.default_rng(0))
    geometry = true_geometry(truth)
    assert pitch_of(geometry, upright, BOARD) == pytest.approx(down, abs=math.radians(0.15))


def test_a_rig_that_hangs_askew_is_to_be_shimmed() -> None:
    geometry = true_geometry(RigTruth())
    rng = np.random.default_rng(0)
    askew = held(BOARD, u=0.0, v=0.0, distance=0.4, turn=(0, 0, math.radians(3)))
    with pytest.raises(NotCalibrated, match=r"hangs 3\.0 degrees down to the left"):
        pitch_of(geometry, views(RigTruth(), askew, rng), BOARD)
    steep = held(BOARD, u=0.0, v=0.0, distance=0.4, turn=(math.radians(9), 0, 0))
    with pytest.raises(NotCalibrated, match=r"looks (8|9)\.\d degrees down"):
        pitch_of(geometry, views(RigTruth(), steep, rng), BOARD)


# The board shown again ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_knock_is_seen_with_one_view_of_the_board(axis: int) -> None:
    truth = built_rig(np.random.default_rng(6))
    found, rng = calibrated(pairs_of(truth)), np.random.default_rng(0)
    pose = held(BOARD, u=0.1, v=0.0, distance=0.4, turn=(0.2, 0.1, 0.0))
    off, scale = check_rig(found.geometry, views(truth, pose, rng), BOARD, found.epipolar)
    assert off < 0.25
    assert scale == pytest.approx(1, abs=0.005)
    turn = [0.0, 0.0, 0.0]
    turn[axis] = math.radians(0.7)
    knocked = RigTruth(truth.lenses, (truth.mounts[0], truth.mounts[1].moved((turn[0], turn[1], turn[2]))))
    with pytest.raises(RigMoved):
        check_rig(found.geometry, views(knocked, pose, rng), BOARD, found.epipolar)
    with pytest.raises(NotCalibrated, match="fewer than 8"):
        check_rig(found.geometry, BoardPair(None, None), BOARD, found.epipolar)


# The file -----------------------------------------------------------------------------------------------------


def test_a_calibration_is_kept_to_the_last_digit(tmp_path: Path) -> None:
    with pytest.raises(NotCalibrated, match="no stereo calibration"):
        load_calibration(tmp_path)
    found = calibrated(pairs_of(built_rig(np.random.default_rng(3))))
    file = save_calibration(found, tmp_path)
    again = load_calibration(tmp_path)
    assert again == found
    assert np.allclose(again.geometry.rotation @ again.geometry.rotation.T, np.eye(3), atol=1e-12)
    assert again.opencv == cv2.__version__
    text = file.read_text()
    for spoilt in (text[: len(text) // 2], text.replace("version: 1", "version: 2"), "", "left: [1"):
        file.write_text(spoilt)
        with pytest.raises(CalibrationForeign, match="stereo"):
            load_calibration(tmp_path)


def test_a_calibration_is_refused_where_it_does_not_belong() -> None:
    found = true_calibration(RigTruth(), left_id="a", right_id="b")
    found.require(left_id="a", right_id="b", size=SIZE)
    with pytest.raises(CalibrationForeign, match="exchange left and right"):
        found.require(left_id="b", right_id="a", size=SIZE)
    with pytest.raises(CalibrationForeign, match="another right camera: b instead of c"):
        found.require(left_id="a", right_id="c", size=SIZE)
    with pytest.raises(CalibrationForeign, match="640 x 480 instead of 320 x 240"):
        found.require(left_id="a", right_id="b", size=(320, 240))
    with pytest.raises(CalibrationForeign, match=r"OpenCV 4\.13"):
        found.model_copy(update={"opencv": "4.13.0"}).require(left_id="a", right_id="b", size=SIZE)
    later = found.created + datetime.timedelta(days=91)
    with pytest.raises(CalibrationStale, match="91 days old"):
        found.require(left_id="a", right_id="b", size=SIZE, now=later)
    found.require(left_id="a", right_id="b", size=SIZE, now=later, oldest=100)
    with pytest.raises(CalibrationStale, match="from now"):
        found.require(left_id="a", right_id="b", size=SIZE, now=later - datetime.timedelta(days=200))


def test_the_lens_of_a_rendered_board_is_a_lens() -> None:
    """Straight edges of the board are bent by as much as the lens says."""
    lens = Lens(distortion=(-0.15, 0.0, 0.0, 0.0, 0.0))
    pose = held(BOARD, u=-0.55, v=-0.5, distance=0.35)
    picture = BoardScene(BOARD, pose).snapshot()(lens, Mount((0, 0, 0)))
    image = developed(picture, Sensor(), np.random.default_rng(0))
    view = BoardDetector(BOARD).find(image)
    assert view is not None
    corners = BOARD.corners()[view.ids] @ pose[:3, :3].T + pose[:3, 3]
    straight = Lens().project(corners)
    assert np.abs(view.points - straight).max() > 5
    assert np.abs(view.points - lens.project(corners)).max() < 0.4
