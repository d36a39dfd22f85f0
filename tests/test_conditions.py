"""What a sweep says: differences to the matched control, and when a claim holds."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from testbed.experiment.conditions import Condition, conditions_of, finding, share_difference
from testbed.scenario.points import Point

CONTROL = Point("control", "sweep", {"size": 1}, ())


def rows_of(cell: str, right: list[tuple[bool, bool]], noise: int | None = None) -> list[dict[str, Any]]:
    """Two verdicts a trial; scores as far apart as they are right, ties broken by noise."""
    rng = np.random.default_rng(noise)
    rows = []
    for trial, flags in enumerate(right):
        for truth, flag in zip(("appropriate", "inappropriate"), flags, strict=True):
            verdict = truth if flag else {"appropriate": "inappropriate"}.get(truth, "appropriate")
            score = float(verdict == "appropriate") + (0.1 * float(rng.random()) if noise is not None else 0)
            names = {"cell": cell, "trial": trial, "student": "like_me", "robot": "crawler"}
            rows.append({**names, "truth": truth, "verdict": verdict, "score": score})
    return rows


def compared(*cells: list[tuple[bool, bool]], control: list[tuple[bool, bool]]) -> tuple[Condition, ...]:
    points = [Point(f"size_{number}", "sweep", {"size": number}, ()) for number in range(len(cells))]
    rows = rows_of("control", control, noise=0)
    for point, right in zip(points, cells, strict=True):
        rows += rows_of(point.cell, right, noise=1)
    base, others = conditions_of(rows, CONTROL, points)
    assert base is not None
    assert base.measures["auc"].difference is None
    return others


ALL_RIGHT = [(True, True)]


def test_what_is_perfect_everywhere_holds_only_with_enough_trials() -> None:
    few = finding(compared(ALL_RIGHT * 20, ALL_RIGHT * 20, control=ALL_RIGHT * 20), "auc", 0.02)
    assert few.answer == "cannot tell"
    assert few.holding == 0
    assert few.needed is not None
    assert 180 < few.needed < 200
    one_wrong = [(True, True)] * 19 + [(False, True)]
    imperfect = finding(compared(one_wrong, control=ALL_RIGHT * 20), "auc", 0.02)
    assert imperfect.holding == 0  # a little worse cannot be surer
    enough = [ALL_RIGHT * few.needed] * 2
    assert finding(compared(*enough, control=enough[0]), "accuracy", 0.021).answer == "holds"
    for measure in ("auc", "accuracy"):
        many = finding(compared(ALL_RIGHT * 200, control=ALL_RIGHT * 200), measure, 0.02)
        assert (many.answer, many.holding, many.needed) == ("holds", 1, None)
    assert finding(compared(ALL_RIGHT * 20, control=ALL_RIGHT * 20), "auc", 0.5).answer == "holds"


def test_a_clear_loss_in_one_condition_refutes_the_claim_and_is_named() -> None:
    half = [(True, True), (False, True), (True, False), (False, False)] * 10
    others = compared(ALL_RIGHT * 40, half, control=ALL_RIGHT * 40)
    for measure in ("auc", "accuracy"):
        found = finding(others, measure, 0.02)
        assert found.answer == "does not hold"
        assert found.worst is not None
        assert found.worst.cell == "size_1"


def test_many_conditions_take_a_stricter_look() -> None:
    """A loss that is just significant alone is not when it is the worst of forty conditions."""
    some = [(True, True)] * 24 + [(False, True)] * 16
    control = [*ALL_RIGHT * 39, (True, False)]
    alone = compared(some, control=control)
    among = compared(some, *[ALL_RIGHT * 40] * 39, control=control)
    assert finding(alone, "accuracy", 0.005).answer == "does not hold"
    assert finding(among, "accuracy", 0.005).answer == "cannot tell"
    assert alone[0].measures["accuracy"].interval == among[0].measures["accuracy"].interval


def test_a_single_trial_tells_nothing() -> None:
    found = finding(compared(ALL_RIGHT, control=ALL_RIGHT), "accuracy", 0.5)
    assert (found.answer, found.needed) == ("cannot tell", None)


def test_without_a_control_nothing_is_compared() -> None:
    base, others = conditions_of(rows_of("a", ALL_RIGHT * 5), CONTROL, [Point("a", "sweep", {"size": 2}, ())])
    assert base is None
    assert others[0].measures["auc"].value == 1
    assert finding(others, "auc", 0.02).answer == "cannot tell"


flags = st.lists(st.tuples(st.booleans(), st.booleans()), min_size=2, max_size=30)


@settings(max_examples=40, deadline=None)
@given(one=flags, other=flags)
def test_the_difference_of_shares_is_over_common_trials_and_turns_its_sign(
    one: list[tuple[bool, bool]], other: list[tuple[bool, bool]]
) -> None:
    common = min(len(one), len(other))
    first, second = rows_of("a", one), rows_of("b", other)
    there = share_difference(first, second, np.random.default_rng(0))
    back = share_difference(second, first, np.random.default_rng(0))
    assert there is not None
    assert back is not None
    expected = np.mean(one[:common]) - np.mean(other[:common])
    assert there.n == common
    np.testing.assert_allclose(there.value, expected)
    np.testing.assert_allclose(back.value, -expected)
    assert there.interval is not None
    assert back.interval is not None
    np.testing.assert_allclose(there.interval, [-back.interval.high, -back.interval.low], atol=1e-12)
    assert there.interval.low - 1e-12 <= there.value <= there.interval.high + 1e-12


def test_matched_trials_make_the_interval_narrow() -> None:
    """Where the same trials go wrong in both, their difference is certain; where others do, it is not."""
    early, late = [
        [(flag, flag) for flag in row] for row in ([False] * 20 + [True] * 20, [True] * 20 + [False] * 20)
    ]
    rng = np.random.default_rng(0)
    same = share_difference(rows_of("a", early), rows_of("b", early), rng)
    opposite = share_difference(rows_of("a", early), rows_of("b", late), rng)
    assert same is not None
    assert opposite is not None
    assert same.interval is not None
    assert opposite.interval is not None
    assert same.interval == (0, 0)
    assert opposite.interval.high - opposite.interval.low > 0.5
