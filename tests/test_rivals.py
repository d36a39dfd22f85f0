"""Several runs held against each other: matched teachers only, and words that follow the numbers."""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from testbed import cli
from testbed.errors import UserError
from testbed.experiment import runner
from testbed.experiment.executor import Progress
from testbed.experiment.jobs import Job
from testbed.experiment.matching import contenders, differences, matched, read_sides
from testbed.experiment.record import TrialResult
from testbed.experiment.rivals import document, rivalry, verdict_on
from testbed.report.rivals import headline, write_comparison
from testbed.scenario import Scenario, drawn, in_cell, parse_scenario

Make = Callable[..., Path]
SCENARIO = """
name: duel
seed: {seed}
trials: {trials}
student: {student}
beside: {beside}
teachers:
  - {{robot: crawler, gait: {gait}, bearing_deg: -30, distance: {{uniform: [0.9, 1.2]}}}}
  - {{robot: splayed, gait: still, bearing_deg: 30}}
cells: {cells}
"""
DEFAULTS: dict[str, Any] = {
    "seed": 3, "trials": 20, "student": "like_me", "beside": "[]", "cells": "{}", "gait": "crawl", "skill": 3.0,
    "missing": 0,
}  # fmt: skip


def life(scenario: Scenario, skill: float, job: Job, progress: Progress) -> TrialResult:
    """Invented verdicts on the teachers that the scenario draws; minds beside are no good."""
    here = drawn(in_cell(scenario, job.cell), job.trial)
    rows: list[dict[str, Any]] = []
    for place, mind in enumerate(here.minds):
        rng = np.random.default_rng([job.trial, place])
        for index, teacher in enumerate(here.teachers):
            like = teacher.body().name == "crawler"
            score = float((1 if like else -1) * (skill if place == 0 else 0.0) / 2 + rng.normal())
            rows.append(
                {
                    "kind": "verdict", "trial": job.trial, "cell": job.cell, "student": mind.name,
                    "teacher": f"teacher_{index}", "robot": teacher.body().name,
                    "truth": "appropriate" if like else "inappropriate",
                    "verdict": "appropriate" if score > 0 else "inappropriate", "score": score, "found": True,
                    "chosen": False, "scale": teacher.scale, "distance": teacher.distance,
                    "bearing_deg": teacher.bearing_deg, "facing_deg": teacher.facing_deg,
                }
            )  # fmt: skip
    return TrialResult(tuple(rows), {})


@pytest.fixture
def make(tmp_path: Path) -> Make:
    def written(name: str, **said: Any) -> Path:
        given = {**DEFAULTS, **said}
        scenario = parse_scenario(SCENARIO.format(**given), tmp_path / "duel.yaml")
        runner.run(scenario, out=tmp_path / name, compute=functools.partial(life, scenario, given["skill"]))
        for trial in range(given["missing"]):
            (tmp_path / name / "trials" / "default" / f"{trial}.parquet").unlink()
        return tmp_path / name

    return written


def text_of(page: Path) -> str:
    return re.sub(
        r"\s+", " ", re.sub(r"<(style|svg).*?</\1>|<[^>]+>", " ", page.read_text(), flags=re.DOTALL)
    )


def test_a_better_student_is_called_better_and_the_other_way_round(make: Make) -> None:
    good, bad = make("good", trials=40), make("bad", trials=40, student="paper", skill=0.3)
    forth, back = rivalry(read_sides([bad, good])), rivalry(read_sides([good, bad]))
    (up,), (down,) = forth.overall, back.overall
    assert (up.rival.label, down.rival.label) == ("like_me", "paper")
    assert (up.accuracy.n, up.accuracy.trials, up.match.alone) == (80, 40, 0)
    assert verdict_on(up.accuracy, up.adjusted[0]) == verdict_on(up.auc, up.adjusted[1]) == "better"
    assert verdict_on(down.accuracy, down.adjusted[0]) == "worse"
    assert up.accuracy.difference == pytest.approx(-down.accuracy.difference)
    assert up.agreement.only_second == down.agreement.only_first
    assert sum(up.agreement) == 80
    assert "like_me is right about" in headline(forth)
    assert "better (" in headline(forth)
    assert "worse (" in headline(back)


def test_the_same_student_twice_is_no_difference(make: Make) -> None:
    told = rivalry(read_sides([make("one"), make("two")]))
    (only,) = told.overall
    assert only.rival.label == "like_me (two)"
    assert (only.accuracy.difference, only.accuracy.p_value) == (0, 1)
    assert verdict_on(only.accuracy, only.adjusted[0]) == "cannot tell"  # 20 trials
    assert told.differences == []


def test_every_mind_of_every_run_is_a_contender(make: Make) -> None:
    sides = read_sides([make("one", beside="[paper]"), make("two", student="paper")])
    assert [each.label for each in contenders(sides)] == ["like_me", "paper (one)", "paper (two)"]
    told = rivalry(sides)
    assert [each.rival.run for each in told.overall] == ["one", "two"]
    values = [each.accuracy.p_value for each in told.overall] + [
        each.auc.p_value for each in told.overall if each.auc
    ]
    assert (
        min(told.overall[0].adjusted[0], told.overall[1].adjusted[0]) >= min(values) * 4 or max(values) == 1
    )


def test_only_trials_that_both_have_count(make: Make) -> None:
    sides = read_sides([make("long", trials=20), make("short", trials=12, missing=2)])
    match = matched(sides[0], "like_me", sides[1], "like_me")
    assert {row["trial"] for row in match.first} == set(range(2, 12))
    assert match.alone == 20
    for ours, theirs in zip(match.first, match.second, strict=True):
        assert all(ours[name] == theirs[name] for name in ("cell", "trial", "teacher", "robot", "distance"))


@pytest.mark.parametrize(
    ("other", "told"),
    [
        ({"seed": 4}, "their seeds are 3 and 4; run one again with the other's --seed"),
        ({"cells": "{far: {}}"}, "their cells are default and far"),
        ({"trials": 2, "missing": 1}, None),
        ({"gait": "random"}, None),
    ],
)
def test_runs_that_are_not_matched_are_refused_or_told(
    make: Make, other: dict[str, Any], told: str | None
) -> None:
    sides = read_sides([make("one"), make("two", **other)])
    if told is not None:
        with pytest.raises(UserError) as caught:
            rivalry(sides)
        assert told in str(caught.value)
        assert "\n" not in str(caught.value)
        return
    (only,) = rivalry(sides).overall
    teachers = {row["teacher"] for row in only.match.second}
    # With another gait the first teacher is another one; the second is the same still.
    assert teachers == ({"teacher_1"} if "gait" in other else {"teacher_0", "teacher_1"})
    assert only.match.alone > 0


def test_other_teachers_throughout_are_refused_with_the_place(make: Make) -> None:
    one = make("one", cells="{all: {}}")
    two = make("two", cells="{all: {teachers: {all: {scale: 1.5}}}}")
    with pytest.raises(UserError, match=r"cells\.all\.teachers\.all\.scale is - and 1\.5"):
        rivalry(read_sides([one, two]))


def test_trials_of_several_cells_are_no_independent_evidence(make: Make) -> None:
    cells = "{a: {}, b: {}, c: {}}"
    once = rivalry(read_sides([make("one", trials=15), make("two", trials=15, skill=0.8)]))
    thrice = rivalry(
        read_sides([make("a", trials=15, cells=cells), make("b", trials=15, cells=cells, skill=0.8)])
    )
    (single,), (pooled,) = once.overall, thrice.overall
    assert once.by_cell == ()
    assert [each.cell for each in thrice.by_cell] == ["a", "b", "c"]
    assert (pooled.accuracy.n, pooled.accuracy.trials) == (90, 15)
    assert pooled.accuracy.p_value == pytest.approx(single.accuracy.p_value)
    assert pooled.accuracy.interval == pytest.approx(single.accuracy.interval)
    assert all(each.accuracy.p_value == single.accuracy.p_value for each in thrice.by_cell)


def test_what_differs_is_listed_by_place(make: Make) -> None:
    sides = read_sides([make("one"), make("two", student="{robot: splayed}", trials=5)])
    places = dict(differences(sides))
    assert places["student.robot"] == ("crawler", "splayed")
    assert "trials" not in places
    assert all(place.startswith("student") for place in places)


def test_the_page_tells_the_numbers_and_needs_nothing_else(make: Make, tmp_path: Path) -> None:
    cells = "{near: {}, far: {}}"
    folders = [make("bad", student="paper", skill=0.2, cells=cells), make("good", cells=cells)]
    told = rivalry(read_sides(folders))
    page = write_comparison(told, tmp_path / "out")
    first = {path: path.read_bytes() for path in (tmp_path / "out").rglob("*") if path.is_file()}
    assert {path.suffix for path in first} == {".html", ".json", ".svg"}
    contents = page.read_text()
    assert not re.findall(r'(?:src|href)="(?!#|data:)', contents)
    words = text_of(page)
    (only,) = told.overall
    assert headline(told) in words
    assert f"{only.accuracy.second:.1%}" in words
    assert (
        f"both were right about {only.agreement.both}, only paper about {only.agreement.only_first}" in words
    )
    assert "student.method" in words
    assert "near" in words
    numbers = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert numbers == json.loads(json.dumps(document(told)))
    assert numbers["contests"][0]["accuracy"]["difference"] == only.accuracy.difference
    assert len(numbers["cells"]) == 2
    write_comparison(rivalry(read_sides(folders)), tmp_path / "out")  # again, over what is there
    assert {path: path.read_bytes() for path in (tmp_path / "out").rglob("*") if path.is_file()} == first


def test_a_damaged_trial_is_named_on_the_page(make: Make, tmp_path: Path) -> None:
    one, two = make("one"), make("two")
    (two / "trials" / "default" / "7.parquet").write_bytes(b"rubbish")
    told = rivalry(read_sides([one, two]))
    assert "trial 7 of two is damaged" in text_of(write_comparison(told, tmp_path / "out"))
    assert told.overall[0].accuracy.n == 38


def say(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    status = cli._status(cli.app, list(arguments))
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def test_the_command_compares_several_runs(
    make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    one, two = make("one"), make("two", student="paper", skill=0.1)
    status, out, err = say(capsys, "report", str(one), str(two))
    assert (status, err) == (0, "")
    page = Path(out.splitlines()[-1].removeprefix("report: "))
    assert re.fullmatch(r"runs/comparison-[0-9a-f]{8}/report\.html", str(page))
    assert page.is_file()
    told = json.loads(say(capsys, "report", str(one), str(two), "--json", "--out", "here")[1])
    assert told["report"] == "here/report.html"
    assert told["reference"] == {"student": "like_me", "run": "one"}
    for arguments, why in (
        ((str(one), str(two), "--out", str(one)), "holds something else"),
        ((str(one), str(one)), "given twice"),
        ((str(one), "--out", "there"), "leave out --out"),
        ((str(one), str(tmp_path / "nowhere")), "no run directory"),
    ):
        status, out, err = say(capsys, "report", *arguments)
        assert (status, out, err.count("\n")) == (2, "", 1)
        assert why in err
