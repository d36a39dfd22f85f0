"""What the paper found, held against what was found here: sentences made from numbers.

A claim that an error falls is reproduced where the signed-rank test over trials (5% level) and the bootstrap interval
of the mean change both say so. The claim that an error stays flat is reproduced where that interval lies within a
tenth of the start, for want of significance proves nothing by itself. Where too few trials can say either, the
sentence says that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from testbed.experiment.statistics import PairedTest
from testbed.report.reading import APPROPRIATE, INAPPROPRIATE, Row
from testbed.report.series import right_verdicts, start_end

Outcome = Literal["reproduced", "not reproduced", "cannot tell"]

LEVEL = 0.05
FEWEST = 6
"""With five pairs even the clearest fall has p = 0.0625."""
FLAT = 0.10
"""A change within this share of the start counts as flat."""
USEFUL = 0.75
"""While the share of right verdicts may still be this high, chance has not been shown."""


@dataclass(frozen=True)
class Claim:
    """One claim of the paper.

    Attributes:
        claim: What the paper says, with its figure.
        outcome: Whether it was found here.
        finding: What was found here, in numbers.
    """

    claim: str
    outcome: Outcome
    finding: str


def claims(rows: Sequence[Row]) -> tuple[Claim, ...]:
    """Every claim of the paper that these verdict rows speak about."""
    self_test = start_end(rows, "self_error_initial", "self_error_final")
    found = [_falls("The error of self-models falls (Fig. 6).", self_test, "m")]
    for truth, figure in ((APPROPRIATE, "7a"), (INAPPROPRIATE, "7b")):
        article = "an" if truth[0] in "ai" else "a"
        test = start_end(rows, "model_position_error_initial", "model_position_error_final", truth)
        claim = _falls(f"The error of models of {article} {truth} teacher falls (Fig. {figure}).", test, "m")
        overlap = start_end(rows, "model_overlap_initial", "model_overlap_final", truth)
        if overlap is not None:
            seen = change(overlap).replace("It", "The overlap of its silhouettes with the true ones", 1)
            claim = replace(claim, finding=f"{claim.finding} {seen}.")
        found.append(claim)
    columns = ("objective_initial_error", "objective_final_error")
    falls = "The error of controllers for an appropriate teacher falls (Fig. 8)."
    flat = "The error of controllers for an inappropriate teacher stays almost flat (Fig. 8)."
    found.append(_with_eq_5(_falls(falls, start_end(rows, *columns, APPROPRIATE), "rad"), rows, APPROPRIATE))
    found.append(
        _with_eq_5(_flat(flat, start_end(rows, *columns, INAPPROPRIATE), "rad"), rows, INAPPROPRIATE)
    )
    found.append(_better_than_chance(rows))
    return tuple(found)


def _with_eq_5(claim: Claim, rows: Sequence[Row], truth: str) -> Claim:
    """The same claim; its finding also tells the error that the student itself goes by."""
    test = start_end(rows, "initial_error", "final_error", truth)
    if test is None:
        return claim
    told = change(test, "rad").replace("It ", "", 1)
    return replace(claim, finding=f"{claim.finding} The student's own measure, Eq. 5, {told}.")


def _falls(claim: str, test: PairedTest | None, unit: str) -> Claim:
    if test is None:
        return Claim(claim, "cannot tell", "There are no numbers of it in this run.")
    if test.n < FEWEST:
        return Claim(claim, "cannot tell", f"{change(test, unit)}. {_too_few()}")
    if test.fell and test.difference_high < 0:
        return Claim(claim, "reproduced", f"{change(test, unit)}.")
    if test.fell or test.difference_high < 0:
        return Claim(claim, "cannot tell", f"{change(test, unit)}. Test and interval disagree.")
    note = "It did the opposite." if test.p_value < LEVEL else "That is no significant fall."
    return Claim(claim, "not reproduced", f"{change(test, unit)}. {note}")


def _flat(claim: str, test: PairedTest | None, unit: str) -> Claim:
    if test is None:
        return Claim(claim, "cannot tell", "There are no numbers of it in this run.")
    if test.n < FEWEST:
        return Claim(claim, "cannot tell", f"{change(test, unit)}. {_too_few()}")
    margin = FLAT * test.start_mean
    within = max(abs(test.difference_low), abs(test.difference_high)) <= margin
    if within:
        return Claim(claim, "reproduced", f"{change(test, unit)}. That is within a tenth of its start.")
    if test.p_value < LEVEL:
        return Claim(claim, "not reproduced", f"{change(test, unit)}. That change is significant.")
    note = "That is not significant, but a change of more than a tenth is not excluded."
    return Claim(claim, "cannot tell", f"{change(test, unit)}. {note}")


def _better_than_chance(rows: Sequence[Row]) -> Claim:
    claim = "The student tells appropriate from inappropriate teachers."
    right, (low, high) = right_verdicts(rows)
    n = len(rows)
    finding = (
        f"{right} of {n} verdicts were right: {right / n:.0%}, interval {low:.0%} to {high:.0%}; a coin: 50%."
    )
    if low > 0.5:
        return Claim(claim, "reproduced", finding)
    outcome: Outcome = "cannot tell" if high >= USEFUL else "not reproduced"
    return Claim(claim, outcome, finding)


def change(test: PairedTest, unit: str = "") -> str:
    """From where to where something went, with its interval, test and N: a sentence without its full stop."""
    start, end = f"{test.start_mean:.3g}", f"{test.end_mean:.3g}"
    way = "fell" if test.difference < 0 else "rose"
    text = f"It stayed at {start}" if start == end else f"It {way} from {start} to {end}"
    text += f" {unit}" if unit else ""
    if test.n == 1:
        return f"{text} (N = 1)"
    scale = max(abs(test.start_mean), abs(test.difference))
    moved, low, high = (
        _signed(value, scale) for value in (test.difference, test.difference_low, test.difference_high)
    )
    return f"{text} (change {moved}, interval {low} to {high}; {p_text(test.p_value)}; N = {test.n})"


def p_text(p: float) -> str:
    """A p-value as papers write it."""
    return "p < 0.001" if p < 0.001 else f"p = {p:.2g}"


def _signed(value: float, scale: float) -> str:
    """A change to a hundredth of what changed."""
    decimals = 3 if scale <= 0 else max(0, 2 - math.floor(math.log10(scale)))
    return f"{value:+.{decimals}f}".replace("-", "\N{MINUS SIGN}")


def _too_few() -> str:
    return f"Fewer than {FEWEST} trials cannot show significance."
