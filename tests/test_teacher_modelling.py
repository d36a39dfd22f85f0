"""Teacher modelling against a plain reimplementation of Section 3.3.3, and for what it promises."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from testbed.student.parameters import TeacherModellingParameters
from testbed.student.seeing import _mutation
from testbed.student.seeing.teacher_modelling import Modelling, TeacherRecord, draw, random_models
from testbed.vision import CAPPED_CYLINDER, CUBOID, SPHERE, StereoRig, luminosity, render

RIG = StereoRig()
Array = NDArray[np.float64]
Images = NDArray[np.uint8]

BODY = (CUBOID, -0.1, 0.1, 0.9, 0.0, 0.14, 0.11, 0.05)
LIMB = (CAPPED_CYLINDER, 0.06, 0.06, 0.9, -0.4, 0.01, 0.2, 0.0)
TEACHER = np.array([BODY, LIMB, (CAPPED_CYLINDER, 0.22, 0.06, 0.9, 0.5, 0.01, 0.2, 0.0)])


def teacher_images(roll: float = 0.0) -> Images:
    parts = TEACHER.copy()
    parts[2, 4] += roll
    return render(parts, RIG, part_luminosity=110)


def run(
    seed: int, images: list[Images], parts: int = 3, **open_parameters: object
) -> tuple[Modelling, TeacherRecord]:
    parameters = TeacherModellingParameters.model_validate(open_parameters)
    modelling = Modelling(RIG, parts, parameters, np.random.default_rng(seed))
    for left, right in images:
        modelling.observe(left, right)
    return modelling, modelling.record()


class Plain:
    """Section 3.3.3 in plain NumPy: whole lists of pixels, every error from scratch, nothing kept."""

    def __init__(self, seed: int, parts: int, p: TeacherModellingParameters) -> None:
        self.p, self.parts, self.rng = p, parts, np.random.default_rng(seed)
        self.models = list(random_models(2, parts, RIG, p, self.rng))
        self.order = list(range(7500))
        # One list a camera of (pixel, label), the oldest first.
        self.buffer: list[list[tuple[int, int]]] = [[], []]
        self.histories: list[tuple[Array, ...]] = []
        self.better: list[int] = []
        self.errors: list[list[float]] = []
        self.chosen: list[list[int]] = []

    def error(self, model: Array) -> float:
        terms = []
        for camera, known in enumerate(self.buffer):
            pixels = np.array([(pixel % 100, pixel // 100) for pixel, _ in known])
            target = np.array([label for _, label in known], dtype=float)
            seen = luminosity(model, RIG, pixels, self.p.part_luminosity)[camera].astype(float)
            terms.append(math.sqrt(((target - seen) ** 2).sum()) / len(known))
        return terms[0] + terms[1]

    def explore(self, images: Images, uniforms: Array) -> None:
        for j, u in enumerate(uniforms):
            other = j + int(u * (7500 - j))
            self.order[j], self.order[other] = self.order[other], self.order[j]
        candidates = np.array(self.order[: len(uniforms)])
        views = [render(model, RIG, self.p.part_luminosity).reshape(2, -1) // 255 for model in self.models]
        self.chosen.append([])
        for camera in range(2):
            delta = np.abs(views[0][camera].astype(int) - views[1][camera])[candidates]
            pixel = int(candidates[np.argmax(delta)])
            self.chosen[-1].append(pixel)
            self.buffer[camera].append((pixel, int(images[camera].reshape(-1)[pixel])))
            self.buffer[camera] = self.buffer[camera][-self.p.buffer :]

    def bound(self, part: Array) -> None:
        part[3] = np.clip(part[3], *self.p.depth_bounds)
        wide = part[3] * math.tan(RIG.field_of_view / 2.0)
        part[1], part[2] = np.clip(part[1], -wide, wide), np.clip(part[2], -0.75 * wide, 0.75 * wide)
        low, high = self.p.extent_bounds
        if part[0] == CUBOID:
            part[5:] = np.clip(part[5:], low, high)
        else:
            part[5] = np.clip(part[5], low / 2.0, high / 2.0)
            part[6:] = np.clip(part[6:], 0.0, high)

    def mutated(self, model: Array, variables: Array, normals: Array, shapes: Array) -> Array:
        p = self.p
        widths = [0.0, p.position_width, p.position_width, p.depth_width, p.roll_width, *[p.size_width] * 3]
        child = model.copy()
        for variable, normal, shape in zip(variables, normals, shapes, strict=True):
            part, column = child[int(variable) // 8], int(variable) % 8
            if column == 0:
                _mutation.change_shape(part, int(shape), 2.0)  # has tests of its own
            else:
                part[column] += widths[column] * normal
            self.bound(part)
        return child

    def observe(self, images: Images) -> None:
        draws = draw(self.parts, 7500, self.p, self.rng)
        for t in range(self.p.passes_per_image):
            self.explore(images, draws.candidates[t])
            for step in range(self.p.estimation_iterations):
                for m in range(2):
                    at = (t, step, m, slice(0, draws.counts[t, step, m]))
                    child = self.mutated(
                        self.models[m], draws.variables[at], draws.normals[at], draws.shapes[at]
                    )
                    if self.error(child) < self.error(self.models[m]):
                        self.models[m] = child
                self.histories.append(tuple(self.models))
                self.better.append(int(np.argmin([self.error(model) for model in self.models])))
            self.errors.append([self.error(model) for model in self.models])


@pytest.mark.parametrize(("seed", "parts", "buffer"), [(1, 3, 16), (2, 2, 7), (3, 1, 1000)])
def test_is_the_algorithm_of_the_paper(seed: int, parts: int, buffer: int) -> None:
    """Eq. 3, Eq. 4, the ring buffer, labels that stay, strict improvement, the record of the better model."""
    small = {"passes_per_image": 30, "candidate_pixels": 200, "buffer": buffer, "estimation_iterations": 4}
    images = [teacher_images(), teacher_images(0.6)]
    _, record = run(seed, images, parts, **small)
    _, jumping = run(seed, images, parts, history_of="best_each_iteration", **small)
    plain = Plain(seed, parts, TeacherModellingParameters.model_validate(small))
    for pair in images:
        plain.observe(pair)
    assert np.array_equal(record.pixels[..., 1].astype(int) * 100 + record.pixels[..., 0], plain.chosen)
    best = plain.better[-1]
    np.testing.assert_allclose(record.history, [pair[best] for pair in plain.histories], rtol=1e-12)
    at_its_time = [pair[better] for pair, better in zip(plain.histories, plain.better, strict=True)]
    np.testing.assert_allclose(jumping.history, at_its_time, rtol=1e-12)
    initial = random_models(2, parts, RIG, plain.p, np.random.default_rng(seed))
    assert np.array_equal(record.initial, initial[best])
    np.testing.assert_allclose(record.error, plain.errors, rtol=1e-12)


def test_pixels_are_chosen_where_the_models_disagree() -> None:
    modelling = Modelling(RIG, 3, TeacherModellingParameters(passes_per_image=1), np.random.default_rng(5))
    before = [render(model, RIG) == 255 for model in modelling.models]
    modelling.observe(*teacher_images())
    record = modelling.record()
    for camera in range(2):
        u, v = record.pixels[0, camera]
        assert record.disagreed[0, camera] == (before[0][camera, v, u] != before[1][camera, v, u])
    assert record.disagreed.all()  # two random models always differ somewhere


def test_if_no_candidate_disagrees_the_first_is_taken() -> None:
    modelling = Modelling(RIG, 1, TeacherModellingParameters(passes_per_image=1), np.random.default_rng(4))
    modelling.models[1] = modelling.models[0]
    modelling.observe(*teacher_images())
    record = modelling.record()
    assert not record.disagreed.any()
    assert np.array_equal(record.pixels[0, 0], record.pixels[0, 1])  # the same candidates for both eyes


def test_old_pixels_keep_the_labels_of_their_own_image() -> None:
    black, white = np.zeros((2, 75, 100), np.uint8), np.full((2, 75, 100), 255, np.uint8)
    modelling, _ = run(0, [black, white], passes_per_image=4, buffer=6)
    # Six slots: passes 7 and 8 overwrote the two oldest, which leaves two of the black image.
    assert np.array_equal(modelling.memory.if_white[0] == 255**2, [False, False, True, True, False, False])


def test_what_is_kept_is_what_would_be_found_from_scratch() -> None:
    modelling, record = run(8, [teacher_images(), teacher_images(0.5)], passes_per_image=150, buffer=100)
    newest = record.pixels[-100:]
    slots = np.arange(200, 300) % 100
    pairs = np.repeat([0, 1], 150)[-100:]
    for m, model in enumerate(modelling.models):
        for camera in range(2):
            pixels = newest[:, camera]
            for k, part in enumerate(model):
                alone = luminosity(part[None], RIG, pixels)[camera] < 255
                assert np.array_equal(modelling.memory.rows[m, camera, k, slots], alone)
            labels = record.images[pairs, camera, pixels[:, 1], pixels[:, 0]].astype(int)
            squares = (labels - luminosity(model, RIG, pixels)[camera]) ** 2
            assert modelling.memory.sums[m, camera] == squares.sum()


def test_the_same_seed_gives_the_same_bytes_and_another_does_not() -> None:
    images = [teacher_images(), teacher_images(0.2)]
    first, again, other = (run(seed, images, passes_per_image=60)[1] for seed in (7, 7, 8))
    assert first.history.tobytes() == again.history.tobytes()
    assert first.pixels.tobytes() == again.pixels.tobytes()
    assert first.history.tobytes() != other.history.tobytes()


def test_a_full_run_records_what_imitation_reads() -> None:
    _, record = run(11, [teacher_images(), teacher_images(0.2), teacher_images(0.4)])
    assert record.history.shape == (24000, 3, 8)
    assert record.error.shape == record.disagreed.shape == (3000, 2)
    assert record.pixels.shape == (3000, 2, 2)
    assert record.pixels.dtype == np.int16
    assert record.images.shape == (3, 2, 75, 100)
    assert np.array_equal(record.motion.sampled(240), record.history[99::100])


def overlap(model: Array, images: Images) -> float:
    seen, truth = render(model, RIG) < 255, images < 255
    return float(np.count_nonzero(seen & truth) / np.count_nonzero(seen | truth))


def test_models_come_to_look_like_the_teacher() -> None:
    images = teacher_images()
    better = 0
    for seed in range(20):
        p = TeacherModellingParameters()
        start = random_models(2, 3, RIG, p, np.random.default_rng(seed))
        _, record = run(seed, [images])
        better += overlap(record.final, images) > max(overlap(model, images) for model in start)
    assert better >= 18  # by chance: p < 0.0003


def test_models_follow_the_teacher_to_a_new_image() -> None:
    there, elsewhere = teacher_images(), np.roll(teacher_images(), -20, axis=2)
    gains = []
    for seed in range(12):
        modelling, _ = run(seed, [there])
        before = max(overlap(model, elsewhere) for model in modelling.models)
        modelling.observe(*elsewhere)
        gains.append(overlap(modelling.record().final, elsewhere) - before)
    assert sum(gain > 0.0 for gain in gains) >= 11


@settings(max_examples=200, deadline=None)
@given(
    st.sampled_from((CUBOID, SPHERE, CAPPED_CYLINDER)),
    st.sampled_from((CUBOID, SPHERE, CAPPED_CYLINDER)),
    st.tuples(*[st.floats(0.02, 0.4)] * 3),
)
def test_a_change_of_shape_keeps_the_visible_extents(
    old: int, new: int, sizes: tuple[float, float, float]
) -> None:
    part = np.array([old, 0.0, 0.0, 1.0, 0.3, *sizes])
    across, tall = extents(part)
    _mutation.change_shape(part, new, 2.0)
    assert part[0] == new
    assert np.all(part[5:] >= 0.0)
    after = extents(part)
    if new in (CUBOID, old) or (new == CAPPED_CYLINDER and across >= tall):
        assert after == pytest.approx((across, tall))
    else:  # as wide as it is high: the product is what can be kept
        assert after[0] * after[1] == pytest.approx(across * tall)


def extents(part: Array) -> tuple[float, float]:
    """Full width and height along the part's own axes."""
    if part[0] == CUBOID:
        return float(part[5]), float(part[7])
    length = part[6] if part[0] == CAPPED_CYLINDER else 0.0
    return float(length + 2.0 * part[5]), float(2.0 * part[5])


@pytest.mark.parametrize("old", [CUBOID, SPHERE, CAPPED_CYLINDER])
@pytest.mark.parametrize("new", [CUBOID, SPHERE, CAPPED_CYLINDER])
def test_a_change_of_shape_is_slight_to_the_eye(old: int, new: int) -> None:
    sizes = {CUBOID: (0.24, 0.1, 0.16), SPHERE: (0.1, 0.0, 0.0), CAPPED_CYLINDER: (0.08, 0.08, 0.0)}[old]
    part = np.array([old, 0.0, 0.0, 1.0, 0.3, *sizes])
    images = render(part[None], RIG)
    _mutation.change_shape(part, new, 2.0)
    assert overlap(part[None], images) > 0.6


def test_the_letter_of_the_paper_makes_a_cuboid_of_a_circumference() -> None:
    part = np.array([SPHERE, 0.0, 0.0, 1.0, 0.0, 0.05, 0.0, 0.0])
    _mutation.change_shape(part, CUBOID, 2.0 * math.pi)
    assert part[5:] == pytest.approx([2.0 * math.pi * 0.05] * 3)
    _mutation.change_shape(part, SPHERE, 2.0 * math.pi)
    assert part[5] == pytest.approx(0.05)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32), st.floats(0.01, 2.0))
def test_parts_stay_in_sight_and_in_bounds(seed: int, width: float) -> None:
    wild = dict.fromkeys(("position_width", "depth_width", "roll_width", "size_width"), width)
    modelling, record = run(seed, [teacher_images()], passes_per_image=20, **wild)
    p = modelling.parameters
    parts = record.history.reshape(-1, 8)
    assert np.all(np.isfinite(parts))
    assert np.all(np.isin(parts[:, 0], (0, 1, 2)))
    assert np.all((parts[:, 3] >= p.depth_bounds[0]) & (parts[:, 3] <= p.depth_bounds[1]))
    for column, pixels in ((1, 100), (2, 75)):
        assert np.all(np.abs(parts[:, column] / parts[:, 3]) <= pixels / 2.0 / RIG.focal + 1e-9)


def test_images_of_another_camera_are_refused() -> None:
    modelling = Modelling(RIG, 3, TeacherModellingParameters(), np.random.default_rng(0))
    with pytest.raises(ValueError, match="nothing has been observed"):
        modelling.record()
    with pytest.raises(ValueError, match=r"\(75, 100\) uint8"):
        modelling.observe(np.zeros((100, 75), np.uint8), np.zeros((100, 75), np.uint8))
    with pytest.raises(ValueError, match="uint8"):
        modelling.observe(np.zeros((75, 100)), np.zeros((75, 100)))
    with pytest.raises(ValueError, match="at least one part"):
        Modelling(RIG, 0, TeacherModellingParameters(), np.random.default_rng(0))
