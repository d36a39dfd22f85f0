"""What one trial leaves behind: plain rows and arrays, nothing that would have to be unpickled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

Row = dict[str, str | int | float | bool | None]


@dataclass(frozen=True)
class TrialResult:
    """One trial.

    Attributes:
        rows: Of kind "verdict", one a mind and teacher: names, truth, verdict, score, and the phases' errors; and of
            kind "self", one a mind: what it came to believe of its body.
        arrays: Histories by name; see :mod:`testbed.experiment.trial_report` for shapes and units.
    """

    rows: tuple[Row, ...]
    arrays: Mapping[str, NDArray[Any]]
