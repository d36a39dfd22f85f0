"""Students of several runs against each other: every one against the first run's leader, on the same teachers."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from testbed.experiment.matching import (
    Contender,
    Match,
    Row,
    Side,
    contenders,
    differences,
    matched,
    why_unmatched,
)
from testbed.experiment.paired import Paired, holm, paired_accuracy, paired_auc

_SEED = 0x41F  # the same runs give the same page
_LEVEL = 0.05
SAME = 0.02
"""Shares and areas that differ by less than this count as the same."""


class Agreement(NamedTuple):
    """How many teachers whom were right about."""

    both: int
    only_first: int
    only_second: int
    neither: int


@dataclass(frozen=True)
class Contest:
    """One student against the reference, on the teachers that both judged.

    Attributes:
        rival: Who.
        cell: In which cell; None: in all that both have.
        match: The verdicts, the reference's first.
        accuracy: Shares of right verdicts.
        auc: Areas under the ROC curve, where both kinds of teachers have scores from both.
        unscored: How many teachers are without a score of either, and so not in the areas.
        adjusted: Holm's p-values of accuracy and AUC, over all contests of its table.
    """

    rival: Contender
    cell: str | None
    match: Match
    accuracy: Paired
    auc: Paired | None
    unscored: int
    adjusted: tuple[float, float | None] = (math.nan, None)

    @property
    def agreement(self) -> Agreement:
        """Whom were right about how many teachers."""
        pairs = [
            (_right(ours), _right(theirs))
            for ours, theirs in zip(self.match.first, self.match.second, strict=True)
        ]
        return Agreement(
            *(pairs.count(kind) for kind in ((True, True), (True, False), (False, True), (False, False)))
        )


@dataclass(frozen=True)
class Rivalry:
    """All that is to be said of several runs.

    Attributes:
        sides: The runs.
        reference: The first run's leader, whom all others are held against.
        overall: One contest a rival, over all cells that it shares with the reference.
        by_cell: The same cell by cell, where there are several.
        differences: Where the runs' scenarios differ: place, and what each run has there.
    """

    sides: tuple[Side, ...]
    reference: Contender
    overall: tuple[Contest, ...]
    by_cell: tuple[Contest, ...]
    differences: Sequence[tuple[str, tuple[str, ...]]]

    @property
    def identity(self) -> str:
        """Eight hexadecimal digits that follow from which runs these are, in this order."""
        names = [(side.name, side.directory.hash8) for side in self.sides]
        return hashlib.sha256(json.dumps(names).encode()).hexdigest()[:8]


def rivalry(sides: Sequence[Side]) -> Rivalry:
    """Hold every student of every run against the first run's leader.

    Raises:
        UserError: If a run has no teacher in common with the first, or there is nobody to compare.
    """
    reference, *rivals = contenders(sides)
    by_name = {side.name: side for side in sides}
    overall, by_cell = [], []
    for rival in rivals:
        one, other = by_name[reference.run], by_name[rival.run]
        match = matched(one, reference.student, other, rival.student)
        if not match.first:
            raise why_unmatched(one, other)
        overall.append(_contest(rival, None, match))
        cells = list(dict.fromkeys(str(row["cell"]) for row in match.first))
        if len(cells) > 1:
            by_cell += [_contest(rival, cell, _within(match, cell)) for cell in cells]
    return Rivalry(tuple(sides), reference, _adjusted(overall), _adjusted(by_cell), differences(sides))


def verdict_on(paired: Paired | None, p_value: float | None) -> str:
    """A difference in plain words."""
    if paired is None or p_value is None or paired.interval is None:
        return "cannot tell"
    if p_value < _LEVEL:
        return "better" if paired.difference > 0 else "worse"
    low, high = paired.interval
    return f"the same within {SAME:.2f}" if max(-low, high) <= SAME else "cannot tell"


def document(told: Rivalry) -> dict[str, Any]:
    """The contents of ``comparison.json``."""
    return {
        "runs": [
            {
                "run": side.name,
                "scenario": side.scenario.name,
                "hash": side.directory.hash8,
                "seed": side.scenario.seed,
                "source": side.directory.provenance.get("source"),
                "damaged": [str(damage) for damage in side.damaged],
            }
            for side in told.sides
        ],
        "reference": {"student": told.reference.student, "run": told.reference.run},
        "contests": [_plain(each) for each in told.overall],
        "cells": [_plain(each) for each in told.by_cell],
        "differences": [{"place": place, "values": list(values)} for place, values in told.differences],
    }


def _contest(rival: Contender, cell: str | None, match: Match) -> Contest:
    first, second = match.first, match.second
    # Equal numbers were drawn alike in every cell: they are no independent evidence.
    trials = np.array([row["trial"] for row in first])
    accuracy = paired_accuracy(
        [_right(row) for row in first], [_right(row) for row in second], trials, np.random.default_rng(_SEED)
    )
    scored = np.array([_scored(ours) and _scored(theirs) for ours, theirs in zip(first, second, strict=True)])
    kept = np.flatnonzero(scored)
    auc = None
    if kept.size:
        auc = paired_auc(
            [first[place]["score"] for place in kept],
            [second[place]["score"] for place in kept],
            [first[place]["truth"] == "appropriate" for place in kept],
            trials[kept],
            np.random.default_rng(_SEED),
        )
    return Contest(rival, cell, match, accuracy, auc, int((~scored).sum()))


def _adjusted(contests: Sequence[Contest]) -> tuple[Contest, ...]:
    """The contests with Holm's p-values over all of their figures together."""
    values = [each.accuracy.p_value for each in contests]
    values += [each.auc.p_value for each in contests if each.auc is not None]
    adjusted = iter(holm(values))
    accuracies = [next(adjusted) for _ in contests]
    return tuple(
        replace(each, adjusted=(accuracy, next(adjusted) if each.auc is not None else None))
        for each, accuracy in zip(contests, accuracies, strict=True)
    )


def _within(match: Match, cell: str) -> Match:
    kept = [place for place, row in enumerate(match.first) if row["cell"] == cell]
    return Match(tuple(match.first[i] for i in kept), tuple(match.second[i] for i in kept), 0)


def _right(row: Row) -> bool:
    return bool(row["verdict"] == row["truth"])


def _scored(row: Row) -> bool:
    return row.get("score") is not None and math.isfinite(row["score"])


def _plain(contest: Contest) -> dict[str, Any]:
    accuracy, auc = contest.accuracy, contest.auc
    return {
        "student": contest.rival.student,
        "run": contest.rival.run,
        "cell": contest.cell,
        "teachers": accuracy.n,
        "trials": accuracy.trials,
        "unmatched": contest.match.alone,
        "unscored": contest.unscored,
        **contest.agreement._asdict(),
        "accuracy": _figure(accuracy, contest.adjusted[0]),
        "auc": _figure(auc, contest.adjusted[1]),
    }


def _figure(paired: Paired | None, adjusted: float | None) -> Mapping[str, Any] | None:
    if paired is None:
        return None
    low, high = paired.interval or (None, None)
    return {
        "reference": paired.first,
        "student": paired.second,
        "difference": paired.difference,
        "difference_low": low,
        "difference_high": high,
        "p_value": paired.p_value,
        "p_holm": adjusted,
        "outcome": verdict_on(paired, adjusted),
    }
