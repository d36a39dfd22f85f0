"""The page of a run: whole, true to its run directory, the same every time."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
import synthetic_run
from matplotlib.figure import Figure
from synthetic_run import CONTROL_STEP, LOOKS, PERFORM_START, PERFORM_STEPS, Story, write_synthetic_run

from testbed.bodies.morphology import Morphology
from testbed.errors import UserError
from testbed.report.claims import claims
from testbed.report.desk import Desk
from testbed.report.figures import figure_7
from testbed.report.page import write_report
from testbed.report.reading import Trial, read_run
from testbed.report.seen import draw_imagined, models_of, moments_of
from testbed.report.story import teacher_modelling
from testbed.report.video import RATE, frame_count, panes, stride_of
from testbed.resources import robot_path
from testbed.vision import StereoRig, render

VOID = {"meta", "link", "img", "br", "hr", "input", "source"}


class Page(HTMLParser):
    """What a reader of the page gets at: tags in balance, sources, ids, rows of the verdict table."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.sources: list[str] = []
        self.ids: list[str] = []
        self.numbers: list[list[str]] = []
        self.cells: list[list[str]] = []
        self.tags: list[str] = []
        self.seen: set[str] = set()
        self._in_verdicts = False
        self.feed(text)
        assert not self.tags, f"not closed: {self.tags}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._start(tag, attrs)
        if tag not in VOID:
            self.tags.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._start(tag, attrs)

    def _start(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.add(tag)
        values = dict(attrs)
        self.ids += [values["id"] or ""] if "id" in values else []
        self.sources += [
            values[key] or "" for key in ("src", "href", "xlink:href", "poster") if key in values
        ]
        if tag == "table":
            self._in_verdicts = values.get("class") == "verdicts"
        elif tag == "tr" and self._in_verdicts:
            self.numbers.append([])
            self.cells.append([])
        elif tag == "td" and self._in_verdicts:
            self.cells[-1].append("")
        elif tag == "data" and self._in_verdicts:
            self.numbers[-1].append(values["value"] or "")

    def handle_endtag(self, tag: str) -> None:
        self._in_verdicts = self._in_verdicts and tag != "table"
        assert self.tags.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._in_verdicts and self.tags and self.cells and self.cells[-1] and "td" in self.tags:
            self.cells[-1][-1] += data


@pytest.fixture(scope="module", autouse=True)
def walked_once() -> Iterator[None]:
    """The invented crawl of a body is the same in every run here: it is worked out once."""
    known: dict[tuple[str, int, float], tuple[np.ndarray, np.ndarray]] = {}

    def crawl(body: Morphology, steps: int, depth: float) -> tuple[np.ndarray, np.ndarray]:
        key = (body.name, steps, depth)
        if key not in known:
            known[key] = walk(body, steps, depth)
        return known[key]

    walk = synthetic_run.crawl
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(synthetic_run, "crawl", crawl)
        yield


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of one trial in which the student imitates the crawler, and its report."""
    folder = write_synthetic_run(tmp_path_factory.mktemp("one"), passes=60)
    write_report(folder)
    return folder


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of seven trials, and its report."""
    story = Story(trials=7, right=0.8, falling=(("appropriate", False), ("inappropriate", True)))
    folder = write_synthetic_run(tmp_path_factory.mktemp("many"), story, passes=60)
    write_report(folder)
    return folder


@pytest.fixture(scope="module")
def nobody(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run in which one teacher was not found and nobody imitated, described in markup, and its report."""
    story = Story(chosen=None, found=(False, True))
    folder = write_synthetic_run(tmp_path_factory.mktemp("nobody"), story, passes=30)
    file = folder / "scenario.resolved.yaml"
    text = file.read_text()
    assert "Invented numbers." in text
    file.write_text(text.replace("Invented numbers.", "<script>alert('&')</script>"))
    write_report(folder)
    return folder


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Trial:
    """The only trial of a small run without a report."""
    return read_run(write_synthetic_run(tmp_path_factory.mktemp("small"), passes=30)).trials[0]


def text_of(folder: Path) -> str:
    return (folder / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["one", "many", "nobody"])
def test_the_page_needs_nothing_from_elsewhere(name: str, request: pytest.FixtureRequest) -> None:
    text = text_of(request.getfixturevalue(name))
    page = Page(text)
    assert page.sources
    assert all(source.startswith(("data:", "#")) for source in page.sources)
    assert not re.search(r"url\((?!#)", text)
    assert not page.seen & {"script", "link", "iframe", "object"}
    assert len(page.ids) == len(set(page.ids))


@pytest.mark.parametrize("name", ["one", "many", "nobody"])
def test_numbers_in_the_table_are_those_of_the_verdicts_file(
    name: str, request: pytest.FixtureRequest
) -> None:
    folder = request.getfixturevalue(name)
    rows = json.loads((folder / "verdicts.json").read_text())["verdicts"]
    page = Page(text_of(folder))
    header, *numbers = page.numbers
    assert header == []
    keys = ("score", "initial_error", "final_error")
    assert [[float(value) for value in line] for line in numbers] == [
        [row[key] for key in keys if row[key] is not None] for row in rows
    ]
    for row, cells in zip(rows, page.cells[1:], strict=True):
        joined = " ".join(cells)
        assert row["teacher"] in joined
        assert row["robot"] in joined
        assert ("✓" in joined) == (row["truth"] == row["verdict"])
        assert ("imitated" in joined) == row["chosen"]
        assert ("not found" in joined) == (not row["found"])


def test_sentences_flip_when_the_data_flip(one: Path, many: Path, tmp_path: Path) -> None:
    def outcome(text: str, claim: str) -> str:
        found = re.search(rf"{claim}.*?class=\"outcome \w+\">([^<]+)<", text, re.DOTALL)
        assert found is not None
        return found.group(1)

    falls = "controllers for an appropriate teacher falls"
    flat = "controllers for an inappropriate teacher stays"
    models = "The error of self-models falls"
    text = text_of(many)
    assert (outcome(text, falls), outcome(text, flat)) == ("not reproduced", "not reproduced")
    assert outcome(text, models) == "reproduced"
    story = Story(trials=7, models_fall=False)
    run = read_run(write_synthetic_run(tmp_path / "other", story, passes=30))
    other = {claim.claim: claim.outcome for claim in claims(run.rows)}
    for claim, expected in ((falls, "reproduced"), (flat, "reproduced"), (models, "not reproduced")):
        assert [found for name, found in other.items() if claim in name] == [expected]
    assert outcome(text_of(one), falls) == "cannot tell"


def test_the_headline_stands_on_the_page(one: Path, nobody: Path) -> None:
    assert "<h1>The student imitated teacher_0 (crawler), rightly" in text_of(one)
    text = text_of(nobody)
    assert "<h1>The student imitated neither teacher" in text
    assert "did not find this teacher" in text
    assert "4. Doing it" not in text
    assert "4. Doing it" in text_of(one)


def test_the_same_run_gives_the_same_page(nobody: Path) -> None:
    before = (nobody / "report.html").read_bytes()
    figures = {path.name: path.read_bytes() for path in (nobody / "figures").iterdir()}
    write_report(nobody)
    assert (nobody / "report.html").read_bytes() == before
    assert {path.name: path.read_bytes() for path in (nobody / "figures").iterdir()} == figures


def test_the_papers_figures_are_kept_as_files(many: Path) -> None:
    names = {path.stem for path in (many / "figures").glob("*.svg")}
    assert {"figure_6", "figure_7a", "figure_7b", "figure_8", "scores"} <= names
    for path in (many / "figures").iterdir():
        ElementTree.parse(path)
        assert "var(--" not in path.read_text()  # a file must be readable without the page's style
    assert "mean ± SEM of 7 trials" in (many / "figures" / "figure_6.svg").read_text()


def with_arrays(trial: Trial, path: Path, **arrays: object) -> Trial:
    """The trial with some of its arrays replaced, kept in another file."""
    np.savez(path, allow_pickle=False, **{**trial.arrays(), **arrays})
    return replace(trial, path=path)


def test_the_page_counts_looks_and_parts(one: Path, tmp_path: Path) -> None:
    assert "looks at each candidate three times and imagines bodies of three parts" in text_of(one)
    run = read_run(write_synthetic_run(tmp_path / "run", passes=30))
    trial = run.trials[0]
    shorter = {}
    for name in ("teacher_0", "teacher_1"):
        shorter |= {
            f"{name}/{key}": value[:2]
            for key in ("look_steps", "images", "truth_parts")
            if (value := trial.array(f"{name}/{key}")) is not None
        }
        history = trial.array(f"{name}/model_history")
        assert history is not None
        shorter[f"{name}/model_history"] = np.concatenate([history, history[:, :1]], axis=1)
    text = teacher_modelling(Desk.of(run), with_arrays(trial, trial.path, **shorter))
    assert "looks at each candidate two times and imagines bodies of four parts" in text


@pytest.mark.parametrize(
    ("passes", "pairs", "expected"),
    [(300, 3, [0, 100, 200, 300]), (10, 3, [0, 4, 7, 10]), (2, 1, [0, 2]), (7, 2, [0, 4, 7])],
)
def test_the_model_after_a_pair_is_the_last_that_the_pair_made(
    passes: int, pairs: int, expected: list[int]
) -> None:
    assert moments_of(passes, pairs) == expected
    numbers = np.arange(passes)  # pass after pass, the pair that it worked on
    assert [int(np.sum(numbers * pairs // passes < pair)) for pair in range(pairs + 1)] == expected


def test_the_first_model_shown_is_the_random_start_and_the_last_the_final_one(one: Path) -> None:
    arrays = models_of(read_run(one).trials[0], "teacher_0")
    history, rig = arrays["model_history"], StereoRig()
    assert len(history) == len(arrays["pixels"]) + 1
    panels = draw_imagined(Figure(), arrays, rig)
    assert [axes.get_title() for axes in panels] == ["start", "pass 20", "pass 40", "pass 60"]
    for axes, row in zip(panels, (0, 20, 40, 60), strict=True):
        assert np.array_equal(axes.images[0].get_array(), render(history[row], rig)[0])


def test_the_curves_of_models_end_at_the_last_pass_and_pairs_change_where_they_did(one: Path) -> None:
    figure = figure_7(read_run(one).trials, "appropriate")
    assert figure is not None
    for axes in figure.axes:
        assert axes.get_xlim() == (0, 60)
        changes = [line.get_xdata()[0] for line in axes.lines if len(set(line.get_xdata())) == 1]
        assert changes == [20, 40]


@pytest.mark.parametrize("step", [0.1, 1 / 15, 0.02, 1 / 60, 0.01667, 0.005])
def test_the_video_lasts_as_long_as_what_it_shows(small: Trial, tmp_path: Path, step: float) -> None:
    trial = with_arrays(small, tmp_path / "0.npz", **{"time/control_step": np.float64(step)})
    shown = panes(trial)
    stride = stride_of(trial)
    assert stride == pytest.approx(1 / 30 / step)
    lasting = min(max(pane.count for pane in shown) * step, 20.0)
    assert frame_count(shown, stride) == pytest.approx(lasting * RATE, abs=1)


def test_a_candidate_is_watched_for_no_longer_than_the_video_lasts(tmp_path: Path) -> None:
    story = Story(chosen=None)
    trial = read_run(write_synthetic_run(tmp_path / "run", story, passes=30)).trials[0]
    looks = {f"teacher_{i}/look_steps": np.array([100, 1200]) for i in (0, 1)}
    slow = {**trial.arrays(), **looks, "time/control_step": np.float64(0.04)}
    np.savez(trial.path, allow_pickle=False, **slow)
    assert [pane.count for pane in panes(trial)] == [500, 500]  # 20 s


def frames_of(path: Path) -> list[np.ndarray]:
    film = cv2.VideoCapture(str(path))
    assert film.get(cv2.CAP_PROP_FPS) == RATE
    frames = []
    while True:
        there, frame = film.read()
        if not there:
            return frames
        frames.append(frame)


def test_the_video_shows_teacher_and_student_for_as_long_as_the_student_imitated(one: Path) -> None:
    trial = read_run(one).trials[0]
    left, right = panes(trial)
    assert (left.agent, left.first, left.count) == ("teacher_0", LOOKS[0] - 1, LOOKS[-1] - LOOKS[0] + 1)
    assert (right.agent, right.first, right.count) == ("student", PERFORM_START - 1, PERFORM_STEPS)
    frames = frames_of(one / "video" / "default-0.mp4")
    assert len(frames) == round(PERFORM_STEPS * CONTROL_STEP * RATE)
    middle = frames[0].shape[1] // 2
    for half in (slice(0, middle), slice(middle, None)):
        moved = np.abs(frames[0][:, half].astype(int) - frames[20][:, half].astype(int)).max()
        assert moved > 60
    # Its demonstration over, the teacher stands still while the student goes on.
    assert np.abs(frames[-1][:, :middle].astype(int) - frames[-20][:, :middle].astype(int)).max() < 40


def test_without_imitation_the_video_shows_who_was_watched(nobody: Path) -> None:
    shown = panes(read_run(nobody).trials[0])
    assert [pane.agent for pane in shown] == ["teacher_1"]
    frames = frames_of(nobody / "video" / "default-0.mp4")
    assert len(frames) == -(-shown[0].count // 2)


def test_text_from_files_is_escaped(nobody: Path) -> None:
    text = text_of(nobody)
    assert "<script>" not in text
    assert "&lt;script&gt;" in text


def test_robots_kept_in_the_run_directory_are_found(tmp_path: Path) -> None:
    folder = write_synthetic_run(tmp_path / "run", Story(robots=("crawler", "splayed")), passes=30)
    (folder / "robots").mkdir()
    (folder / "robots/mine.yaml").write_bytes(robot_path("splayed").read_bytes())
    file = folder / "scenario.resolved.yaml"
    file.write_text(file.read_text().replace("robot: splayed", "robot: robots/mine.yaml"))
    moved = folder.rename(tmp_path / "moved")
    run = read_run(moved)
    bodies = Desk.of(run).bodies(run.trials[0])
    assert bodies["teacher_1"].name == "splayed"
    assert bodies["student"].name == "crawler"


def test_a_folder_that_is_no_run_is_a_users_mistake(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="cannot be read"):
        write_report(tmp_path)


def test_a_damaged_trial_is_told_with_a_mend(tmp_path: Path) -> None:
    folder = write_synthetic_run(tmp_path / "run", passes=30)
    file = folder / "trials" / "default" / "0.npz"
    file.write_bytes(file.read_bytes()[:2000])
    with pytest.raises(UserError, match="run the scenario again"):
        write_report(folder)
    assert not (folder / "report.html").exists()
