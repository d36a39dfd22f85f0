"""The page of a run with several minds, cells and bodies: it tells what the files tell, of the right mind."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from synthetic_minds import ABLATION, Plan, write_minds_run
from synthetic_run import crawl
from test_report import Page

from testbed.bodies.morphology import load_robot
from testbed.experiment.roc import Difference
from testbed.experiment.statistics import Interval, wilson
from testbed.report.candidates import chance, sentence
from testbed.report.comparison import robot_table, verdict_on
from testbed.report.desk import Desk
from testbed.report.explained import draw_explained, explanations, moments_shown, window
from testbed.report.failures import MOST, failure_gallery
from testbed.report.knowing import angle_errors, self_headline
from testbed.report.mending import damage_figure, damage_table
from testbed.report.moving import performed_rolls
from testbed.report.outlines import outline
from testbed.report.page import write_report
from testbed.report.reading import Trial, read_run
from testbed.report.travelling import speeds, travelled
from testbed.vision import StereoRig

CELLS = "{all: {}, control: {}, far: {trials: 2, teachers: {all: {distance: 2.0}}}}"


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One trial of like_me with the paper's student beside it."""
    folder = write_minds_run(tmp_path_factory.mktemp("one"))
    write_report(folder)
    return folder


@pytest.fixture(scope="module")
def cells(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three cells, three minds, of whom the leader often errs."""
    skill = (("like_me", 0.6), ("paper", 0.4), ("attachment", 2.5))
    plan = Plan(trials=4, beside=f"[paper, {ABLATION}]", cells=CELLS, skill=skill, followed=1)
    folder = write_minds_run(tmp_path_factory.mktemp("cells"), plan)
    write_report(folder)
    return folder


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Nobody to watch: random bodies find themselves."""
    damage = "damage: {student: {damage: {limb_lost: random, at: 33}}}"
    plan = Plan(trials=6, teachers="[]", robot="{random: {limbs: 3}}", cells=f"{{whole: {{}}, {damage}}}")
    folder = write_minds_run(tmp_path_factory.mktemp("alone"), plan)
    write_report(folder)
    return folder


def text_of(folder: Path) -> str:
    return (folder / "report.html").read_text(encoding="utf-8")


def contents_of(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "verdicts.json").read_text())  # type: ignore[no-any-return]


@pytest.mark.parametrize("name", ["one", "cells", "alone"])
def test_the_page_is_whole_and_needs_nothing_from_elsewhere(
    name: str, request: pytest.FixtureRequest
) -> None:
    text = text_of(request.getfixturevalue(name))
    page = Page(text)  # sees that every tag is closed
    assert all(source.startswith(("data:", "#")) for source in page.sources)
    assert len(page.ids) == len(set(page.ids))
    assert not re.search(r"\bnan\b", re.sub(r"data:[^\"]+", "", text), re.IGNORECASE)


def test_every_mind_says_its_verdict_with_probability_and_reason(one: Path) -> None:
    text = text_of(one)
    told = text[text.index('<table class="minds">') : text.index("The numbers")]
    rows = contents_of(one)["verdicts"]
    assert len(rows) == 4
    for row in rows:
        assert f"<td>{row['student']}</td>" in told
        if row["reason"]:
            assert sentence(row["reason"]).replace("'", "&#x27;") in told
            assert f'<data value="{row["probability"]!r}">' in told
    assert told.count("✓") == sum(row["verdict"] == row["truth"] for row in rows)
    assert told.index(">like_me<") < told.index(">paper<")  # the leader first


def test_both_ways_of_seeing_are_told_each_by_its_own_pictures(one: Path) -> None:
    made = {path.stem for path in (one / "figures").glob("*.svg")}
    assert {
        "explained_teacher_0",
        "rolls_over_time_teacher_0",
        "paper_figure_8",
        "paper_model_teacher_1",
    } <= made
    assert not {"figure_7a", "paper_explained_teacher_0", "model_teacher_0"} & made
    text = text_of(one)
    assert "What was reproduced and what was not (paper)" in text
    assert "1. Who am I? (paper)" in text


def test_arrays_are_those_of_the_mind_that_is_asked(one: Path) -> None:
    trial = read_run(one).trials[0]
    everything = trial.arrays()
    beside, leader = trial.of("paper"), trial.of("like_me")
    assert np.array_equal(beside.array("self/angles"), everything["beside/paper/self/angles"])  # type: ignore[arg-type]
    assert np.array_equal(leader.array("self/angles"), everything["self/angles"])  # type: ignore[arg-type]
    assert leader.array("teacher_0/model_history") is None
    assert beside.array("teacher_0/motion_parts") is None
    for name in ("truth/student/base", "perform/steps", "time/control_step"):
        assert np.array_equal(beside.array(name), everything[name])  # type: ignore[arg-type]
    assert {row["student"] for row in beside.rows} == {"paper"}
    assert {row["student"] for row in beside.selves} == {"paper"}


def test_tables_are_about_the_cells_and_students_that_they_name(cells: Path) -> None:
    run, text = read_run(cells), text_of(cells)
    assert run.cells == ("all", "control", "far")
    assert run.students == ("like_me", "paper", "attachment")
    assert "In 4 trials of the cell all the student was right about" in text
    summary = contents_of(cells)["cells"]["all"]
    for name in ("auc", "accuracy", "controller_auc"):
        assert f'<data value="{summary["like_me"][name]!r}">' in text
    assert text.count("the control</td>") == 3  # once in each student's table


def test_the_gallery_shows_the_leaders_wrong_verdicts_and_no_others(cells: Path) -> None:
    run = read_run(cells)
    wrong = [row for row in run.verdicts(student="like_me") if row["verdict"] != row["truth"]]
    shown = failure_gallery(Desk.of(run))
    assert wrong
    assert shown.count("<figure>") == min(len(wrong), MOST)
    assert f"{len(wrong)} wrong verdict" in shown
    for row in wrong[:MOST]:
        assert f"{row['cell']}, trial {row['trial']}: {row['robot']}</strong>" in shown


def test_a_run_without_teachers_is_about_bodies(alone: Path) -> None:
    text = text_of(alone)
    selves = contents_of(alone)["selves"]
    own = [row["topology_right"] for row in selves if row["cell"] == "whole"]
    assert f"In {sum(own)} of {len(own)} trials of the cell whole the student found out" in text
    assert "<h2>Verdicts</h2>" not in text
    assert "What is that over there" not in text
    damaged = [row for row in selves if row["cell"] == "damage"]
    soon = sum(row["damage_noticed_after"] <= 3 for row in damaged)
    named = sum(row["damage_named_right"] for row in damaged)
    for hits in (soon, named):
        low, high = wilson(hits, len(damaged))
        assert f"{hits} of {len(damaged)}<br><small>{low:.0%} to {high:.0%}</small>" in text


def test_what_became_of_damage_is_told_before_and_after(alone: Path) -> None:
    text = text_of(alone)
    rows = [row for row in contents_of(alone)["selves"] if row["cell"] == "damage"]
    errors = np.array([[row["left_angle_error_deg_first"], row["left_angle_error_deg"]] for row in rows])
    first, anew = np.median(errors, axis=0)
    assert f"{first:.1f}° → {anew:.1f}°" in text
    named = sum(row["damage_named_right_first"] for row in rows)
    assert f"<td>{named} of {len(rows)}<br>" in text
    assert "modelled itself anew" in text
    run = read_run(alone)
    figure = damage_figure(run)
    assert figure is not None
    assert len(figure.axes) == 1  # nothing is known of stuck joints
    whole = replace(run, selves=tuple(row for row in run.selves if not row["damage"]))
    assert damage_table(whole) == ""
    assert damage_figure(whole) is None


def test_the_headline_of_one_body_is_a_sentence() -> None:
    assert self_headline([{"topology_right": False}]) == (
        "The student found out wrongly how its limbs are joined."
    )


@pytest.mark.parametrize(
    ("interval", "words"),
    [
        ((-0.01, 0.02), "within 0.02"),
        ((-0.021, 0.01), "cannot tell whether within 0.02 from 30 trials"),
        ((-0.3, 0.3), "cannot tell whether within 0.02 from 30 trials"),
        ((-0.2, -0.021), "worse by more than 0.02"),
        ((0.03, 0.1), "better by more than 0.02"),
        (None, "cannot tell from 30 trials"),
    ],
)
def test_differences_in_plain_words(interval: tuple[float, float] | None, words: str) -> None:
    assert verdict_on(Difference(30, 0.0, Interval(*interval) if interval else None)) == words


def test_robots_are_counted_by_what_they_are() -> None:
    rows = [
        {"student": "a", "robot": "ball", "truth": "inappropriate", "verdict": verdict}
        for verdict in ("inappropriate", "inappropriate", "appropriate")
    ]
    table = robot_table(rows, ["a", "b"])
    assert "2 of 3" in table
    low, high = wilson(2, 3)
    assert f"{low:.0%} to {high:.0%}" in table
    assert table.count("–") == 1  # b judged nobody


@pytest.mark.parametrize(
    ("probability", "shown"), [(0.999, "&gt; 99%"), (0.001, "&lt; 1%"), (0.5, "50%"), (1.0, "&gt; 99%")]
)
def test_no_probability_looks_certain(probability: float, shown: str) -> None:
    assert f">{shown}<" in chance(probability)


def test_outlines_are_those_of_the_explanation(one: Path) -> None:
    trial, rig = read_run(one).trials[0].of("like_me"), StereoRig()
    own, other = explanations(trial, "teacher_1")
    assert "61%" in own.name
    assert "second limb" in other.name.replace("\n", " ")
    images = trial.array("teacher_1/images")
    assert images is not None
    axes = Figure().subplots()
    draw_explained(axes, images[3, 0], other.parts[3], rig, window(images[:, 0]))
    assert len(axes.patches) == len(other.parts[3])
    for patch, part in zip(axes.patches, other.parts[3], strict=True):
        assert np.asarray(patch.get_path().vertices)[:-1] == pytest.approx(rig.project(outline(part))[0])


def test_a_body_that_cannot_be_thought_of_is_not_drawn(one: Path, tmp_path: Path) -> None:
    trial = read_run(one).trials[0]
    arrays = trial.arrays()
    arrays["teacher_1/explanation_parts_1"] = np.full_like(arrays["teacher_1/explanation_parts_1"], np.nan)
    np.savez(tmp_path / "0.npz", allow_pickle=False, **arrays)
    other = Trial(trial.cell, 0, tmp_path / "0.npz", trial.rows, trial.selves, trial.leader)
    assert len(explanations(other, "teacher_1")) == 1


def test_the_window_holds_the_robot_and_keeps_the_shape() -> None:
    images = np.full((3, 75, 100), 250, np.uint8)
    assert window(images).tolist() == [[-0.5, -0.5], [99.5, 74.5]]
    images[0, 40, 20], images[2, 50, 45] = 60, 80
    low, high = window(images)
    assert np.all(low <= [15, 35])
    assert np.all(high >= [50, 55])
    assert (high - low)[0] / (high - low)[1] == pytest.approx(4 / 3)
    images[1, 0, 0] = images[1, 74, 99] = 0
    assert window(images).tolist() == [[-0.5, -0.5], [99.5, 74.5]]


@pytest.mark.parametrize(("looks", "shown"), [(8, [0, 2, 5, 7]), (3, [0, 1, 2]), (1, [0])])
def test_moments_are_spread_evenly(looks: int, shown: list[int]) -> None:
    assert moments_shown(looks) == shown


def test_performed_rolls_are_the_rolls_of_the_parts(one: Path, tmp_path: Path) -> None:
    body = load_robot("crawler")
    joints, base = crawl(body, 60, -1.0)
    arrays = {
        "perform/start_step": np.array(11), "perform/steps": np.array(40), "time/control_step": np.array(0.1),
        "truth/student/joints": joints, "truth/student/base": base,
    }  # fmt: skip
    np.savez(tmp_path / "0.npz", allow_pickle=False, **arrays)
    found = performed_rolls(Trial("default", 0, tmp_path / "0.npz", ()), body)
    assert found is not None
    times, rolls = found
    assert times == pytest.approx(np.arange(41) * 0.1)
    # Nose down is positive in the sensor and in the image; a chain's angles add up.
    pitch = 2 * np.arctan2(base[10:51, 4], base[10:51, 6])
    expected = np.stack([pitch, pitch + joints[10:51, 0], pitch + joints[10:51].sum(axis=1)], axis=1)
    assert rolls == pytest.approx(expected, abs=1e-5)


def test_angle_errors_go_around_the_circle_and_wrong_topologies_are_wrong(tmp_path: Path) -> None:
    arrays = {
        "self/parents": np.array([[0, 0], [0, 1], [0, 1]]),
        "self/angles": np.radians([[0, 0], [359, 10], [-179, 3]]),
        "self/truth_parents": np.array([0, 1]),
        "self/truth_angles": np.radians([1.0, 3.0]),
    }
    np.savez(tmp_path / "0.npz", allow_pickle=False, **arrays)
    arrays |= {f"self/{name}": arrays[f"self/{name}"][:1] for name in ("parents", "angles")}
    np.savez(tmp_path / "1.npz", allow_pickle=False, **arrays)
    errors = angle_errors([Trial("default", number, tmp_path / f"{number}.npz", ()) for number in (0, 1)])
    assert errors == pytest.approx(np.array([[180, 7, 180], [180, 180, 180]]))
    assert angle_errors([]) is None


def test_speeds_are_in_the_teachers_direction() -> None:
    row = {"path_forward": -0.06, "performed_seconds": 3.0, "distance_ratio": 0.5}
    assert speeds(row) == pytest.approx((0.04, 0.02))
    assert speeds({**row, "distance_ratio": -0.5}) == pytest.approx((0.04, -0.02))


def test_only_teachers_that_travel_are_counted(cells: Path) -> None:
    run = read_run(cells)
    period = 2.0
    rows = []
    for number, per_stroke in enumerate((0.021, 0.019, -0.05)):
        rows.append(
            {
                **run.verdicts(cell="all", student="like_me")[0],
                "trial": number,
                "teacher": "teacher_0",
                "chosen": True,
                "distance_ratio": 0.8,
                "watched_seconds": 4.0,
                "teacher_forward": per_stroke * 4.0 / period,
            }
        )

    desk = Desk(replace(run, rows=tuple(rows)), "like_me")
    assert desk.concrete(desk.trials[0]).teachers[0].gait.period == period
    assert [row["trial"] for row in travelled(desk, "all")] == [0, 2]
    assert not math.isnan(speeds({**rows[0], "path_forward": 0.1, "performed_seconds": 1.0})[0])
