"""``verdicts.json``: what programs read.

Equal trials give equal bytes, whoever computed them and in what order.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from testbed.experiment.atomic import write_text
from testbed.experiment.calibration import calibration_error, calibration_interval
from testbed.experiment.regret import regrets
from testbed.experiment.roc import Scored
from testbed.experiment.statistics import (
    SHARE_SEED,
    Interval,
    auc,
    auc_interval,
    bootstrap_mean,
    share_interval,
)
from testbed.scenario.points import Sweep

FILE = "verdicts.json"
_FIRST = (
    "trial",
    "cell",
    "student",
    "teacher",
    "robot",
    "truth",
    "verdict",
    "score",
    "score_low",
    "score_high",
)
_DIGITS = 9
_BOOTSTRAP = 0xA0C  # keeps the resampling apart from every other use of the scenario's seed
Row = Mapping[str, Any]


def summarise(rows: Sequence[Row], seed: int) -> dict[str, dict[str, Any]]:
    """The statistics of every student, by name.

    Args:
        rows: One row a teacher and trial, as in ``verdicts.json``.
        seed: The scenario's seed; the bootstrap follows from it.

    Returns:
        For each student: ``n`` verdicts and ``trials``; ``auc`` with its interval over trials (None where it
        cannot be told, rows without a score left out); ``accuracy``, the share of right verdicts, with its
        interval over trials; ``calibration_error`` with its interval over trials (only rows with a probability, see
        :mod:`testbed.experiment.calibration`) and how many rows ``calibrated`` counts; ``controller_auc``, the same
        as ``auc`` by the controller alone, whatever the verdict was drawn from; ``found``, how many candidates the
        student found by itself; ``regret`` of its choices, a mean over trials with its interval, see
        :mod:`testbed.experiment.regret`.
    """
    students = dict.fromkeys(str(row["student"]) for row in rows)
    return {
        student: _summary([row for row in rows if row["student"] == student], seed) for student in students
    }


def sweep_rows(sweep: Sweep) -> list[dict[str, Any]]:
    """The cells of a sweep as plain data: of which block, held against which control, and every axis's level."""
    blocks = {block.name: block for block in sweep.blocks.values()}
    return [
        {
            "cell": cell,
            "block": point.block,
            "control": blocks[point.block].control.cell,
            "levels": point.levels,
        }
        for cell, point in sweep.points.items()
    ]


def document(
    name: str,
    hash8: str,
    rows: Iterable[Row],
    seed: int,
    *,
    split: str | None = None,
    sweep: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """The contents of ``verdicts.json``, before rounding: rows by cell, trial, student and teacher.

    Beside the verdicts it lists what every mind came to believe of itself, one row a mind and trial. Where there are
    several cells, ``cells`` has the summary of each by its name. ``split`` is there where the scenario has splits, and
    ``sweep``, one row a cell, where it has a sweep.
    """
    ordered = sorted(
        rows,
        key=lambda row: (row["cell"], row["trial"], row["student"], _natural(row.get("teacher") or "")),
    )
    judged = [row for row in ordered if row.get("kind", "verdict") == "verdict"]
    cells: dict[str, list[Row]] = {}
    for row in judged:
        cells.setdefault(str(row["cell"]), []).append(row)
    contents: dict[str, Any] = {
        "scenario": name,
        "hash": hash8,
        **({"split": split} if split is not None else {}),
        "verdicts": _filled(judged, _FIRST),
        "selves": _filled([row for row in ordered if row.get("kind") == "self"], _FIRST[:3]),
        "summary": summarise(judged, seed),
    }
    if len(cells) > 1:
        contents["cells"] = {cell: summarise(own, seed) for cell, own in cells.items()}
    if sweep:
        contents["sweep"] = list(sweep)
    return contents


def text(contents: Mapping[str, Any]) -> str:
    """``verdicts.json`` as text: one row a line, nine significant digits, NaN written as null."""
    head = [f'  "{key}": {_json(contents[key])}' for key in ("scenario", "hash", "split") if key in contents]
    body = [
        *head,
        *(
            f'  "{key}": [\n{_lines(contents[key])}\n  ]'
            for key in ("verdicts", "selves", "sweep")
            if key in contents
        ),
        *(f'  "{key}": {_by_name(contents[key])}' for key in ("summary", "cells") if key in contents),
    ]
    return "{\n" + ",\n".join(body) + "\n}\n"


def write(folder: Path, contents: Mapping[str, Any]) -> Path:
    """Write ``verdicts.json`` in one step; returns its path.

    Raises:
        UserError: If the disk is full or the folder cannot be written.
    """
    write_text(folder / FILE, text(contents))
    return folder / FILE


def _summary(rows: Sequence[Row], seed: int) -> dict[str, Any]:
    right = [row["verdict"] == row["truth"] for row in rows]
    return {
        "n": len(rows),
        "trials": len({(row["cell"], row["trial"]) for row in rows}),
        **_area_of(rows, "score", "auc", seed),
        "accuracy": sum(right) / len(rows),
        **_named("accuracy", share_interval(right, _trials(rows), np.random.default_rng(SHARE_SEED))),
        **_calibration_of(rows, seed),
        **_area_of(rows, "controller_score", "controller_auc", seed),
        "found": sum(bool(row["found"]) for row in rows),
        **_regret_of(rows, seed),
    }


def scored(rows: Sequence[Row], column: str = "score") -> Scored:
    """The rows that have a number in this column, as scores of what is truly appropriate."""
    kept = [row for row in rows if _is_number(row.get(column))]
    positive = np.array([row["truth"] == "appropriate" for row in kept], dtype=bool)
    return Scored.of([float(row[column]) for row in kept], positive, _trials(kept))


def _area_of(rows: Sequence[Row], column: str, name: str, seed: int) -> dict[str, float | None]:
    having = scored(rows, column)
    spread = auc_interval(*having, np.random.default_rng([_BOOTSTRAP, seed]))
    return {name: auc(having.scores, having.positive), **_named(name, spread)}


def _regret_of(rows: Sequence[Row], seed: int) -> dict[str, float | None]:
    (missed,) = regrets(rows).values()
    spread = bootstrap_mean(missed, np.random.default_rng([_BOOTSTRAP, seed])) if len(missed) > 1 else None
    return {"regret": sum(missed) / len(missed), **_named("regret", spread)}


def _calibration_of(rows: Sequence[Row], seed: int) -> dict[str, float | int | None]:
    having = scored(rows, "probability")
    spread = calibration_interval(*having, np.random.default_rng([_BOOTSTRAP, seed]))
    return {
        "calibrated": len(having.scores),
        "calibration_error": calibration_error(having.scores, having.positive),
        **_named("calibration_error", spread),
    }


def _trials(rows: Sequence[Row]) -> list[str]:
    return [f"{row['cell']}/{row['trial']}" for row in rows]


def _named(name: str, interval: Interval | None) -> dict[str, float | None]:
    low, high = interval or (None, None)
    return {f"{name}_low": low, f"{name}_high": high}


def _by_name(contents: Mapping[str, Any]) -> str:
    """A mapping as JSON, one name a line."""
    listed = ",\n".join(f"    {_json(key)}: {_json(value)}" for key, value in contents.items())
    return f"{{\n{listed}\n  }}"


def _lines(rows: Sequence[Row]) -> str:
    return ",\n".join(f"    {_json(row)}" for row in rows)


def _filled(rows: Sequence[Row], first: Sequence[str]) -> list[dict[str, Any]]:
    """Every row with every column, None where it does not apply, so that programs find what they look for.

    Columns in which no row has anything are those of rows of another kind.
    """
    present = (
        name for row in rows for name, value in row.items() if value is not None or row.get("kind") is None
    )
    columns = dict.fromkeys((*first, *present))
    columns.pop("kind", None)
    return [{name: row.get(name) for name in columns} for row in rows]


def _natural(name: str) -> tuple[str, int, str]:
    """teacher_2 before teacher_10."""
    stem, _, number = name.rpartition("_")
    return (stem, int(number), name) if number.isdecimal() else (name, -1, name)


def _is_number(value: Any) -> bool:
    return value is not None and math.isfinite(value)


def _json(value: Any) -> str:
    return json.dumps(_rounded(value), ensure_ascii=False, allow_nan=False)


def _rounded(value: Any) -> Any:
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        # Adding 0.0 turns a negative zero, which would print as -0.0, into zero.
        return float(f"{float(value):.{_DIGITS}g}") + 0.0 if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _rounded(item) for key, item in value.items()}
    return value
