"""Every column of a run's tables: its name, what it holds, its unit, what it means.

``testbed query`` answers from these tables. ``verdicts`` has a row for each teacher, mind and trial, ``selves`` one for
each mind and trial: what is in ``trials/*/*.parquet``. ``trials`` has one for each trial that the scenario asks for,
``cells`` one for each thing that a cell changes.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, NamedTuple

Kind = Literal["text", "whole", "number", "flag"]


class Column(NamedTuple):
    """One column of a table.

    Attributes:
        name: As queries have it.
        kind: What it holds: text, a whole number, a number, or a flag (true or false). Any value may be missing.
        unit: Of a number; empty where it has none.
        meaning: In one sentence. What begins with "truth" no student can know.
    """

    name: str
    kind: Kind
    unit: str
    meaning: str


# fmt: off
_RUN = Column("run", "text", "", "the run directory, by its last folders")
_CELL = Column("cell", "text", "", "which variant of the scenario; 'default' where it has none")
_TRIAL = Column("trial", "whole", "", "which trial of its cell, from 0; equal numbers are drawn alike in all cells")
_STUDENT = Column("student", "text", "", "which mind, by its name in the scenario")

VERDICTS: tuple[Column, ...] = (
    _RUN, _CELL, _TRIAL, _STUDENT,
    Column("teacher", "text", "", "which candidate: teacher_0, teacher_1, ... in the scenario's order"),
    Column("robot", "text", "", "what the teacher's body is called"),
    Column("truth", "text", "", "truth: 'appropriate' if its body is like the student's, else 'inappropriate'"),
    Column("verdict", "text", "", "the answer in the same words; 'inappropriate' where it was not found"),
    Column("score", "number", "", "the higher, the more like the student; the scale is each student's own"),
    Column("score_low", "number", "", "lower end of the score's interval, of students that give one"),
    Column("score_high", "number", "", "upper end of it"),
    Column("found", "flag", "", "truth: whether the student found this teacher by itself"),
    Column("chosen", "flag", "", "whether it was imitated; never of minds beside the leader"),
    Column("scale", "number", "", "truth: its size as a multiple of what the robot's description says"),
    Column("distance", "number", "m", "truth: how far from the rig it stood"),
    Column("bearing_deg", "number", "deg", "truth: in which direction from the rig, positive to the right"),
    Column("facing_deg", "number", "deg", "truth: how it was turned; at 0 it moves across the view"),
    Column("self_error_initial", "number", "m", "truth: mean distance of the self-model's limbs, at the start"),
    Column("self_error_final", "number", "m", "truth: the same when self-discovery ended"),
    Column("probability", "number", "", "how likely it is appropriate, 0 to 1, of calibrated students"),
    Column("reason", "text", "", "why, in words, of students that say so"),
    Column("controller_verdict", "text", "", "what the controller alone would have answered (Section 3.4)"),
    Column("controller_score", "number", "", "the score of that"),
    Column("controller_probability", "number", "", "the probability of that, 0 to 1"),
    Column("initial_error", "number", "rad", "Eq. 5 of the best controller when imitation began"),
    Column("final_error", "number", "rad", "the same when it ended"),
    Column("objective_initial_error", "number", "rad", "truth: rms error of its rolls when imitation began (eea)"),
    Column("objective_final_error", "number", "rad", "truth: the same when it ended (eea)"),
    Column("model_position_error_initial", "number", "m", "truth: mean distance of modelled parts, at first (eea)"),
    Column("model_position_error_final", "number", "m", "truth: the same in the end (eea)"),
    Column("model_roll_error_initial", "number", "rad", "truth: mean roll error of modelled parts, at first (eea)"),
    Column("model_roll_error_final", "number", "rad", "truth: the same in the end (eea)"),
    Column("model_overlap_initial", "number", "", "truth: silhouettes' intersection over union, at first (eea)"),
    Column("model_overlap_final", "number", "", "truth: the same in the end (eea)"),
    Column("motion_roll_error_median_deg", "number", "deg", "truth: median roll error of a followed motion's parts"),
    Column("motion_roll_error_worst_deg", "number", "deg", "truth: the largest of these errors"),
    Column("parts_in_place", "flag", "", "truth: whether all parts were within 15 degrees in all frames"),
    Column("imitated_roll_error_median_deg", "number", "deg", "truth: the median with parts in imitation's order"),
    Column("explained", "number", "", "how much of what it saw its own body explains, at most 1"),
    Column("best_other", "text", "", "which other body explains most"),
    Column("explained_by_other", "number", "", "how much that one explains, at most 1"),
    Column("unexplained", "number", "", "share of what it saw that no body that it can think of explains, 0 to 1"),
    Column("left_over", "number", "", "as thick a share of that as a main body: from .01 it may be several bodies"),
    Column("crowded", "number", "", "share of its images in which another's outline ran into its own, 0 to 1"),
    Column("hidden", "number", "", "share of its images in which somebody nearer stood before it, 0 to 1"),
    Column("several", "number", "", "how clearly it lies at two distances: from .6 it may be several bodies, 0 to 1"),
    Column("verdict_since", "text", "", "the verdict again with what is left of its body, after damage"),
    Column("path_length", "number", "m", "truth: way of the student's main body while it imitated"),
    Column("path_forward", "number", "m", "truth: how far it came along its own axis"),
    Column("performed_seconds", "number", "s", "for how long it imitated"),
    Column("teacher_forward", "number", "m", "truth: how far the teacher came along its own axis while watched"),
    Column("watched_seconds", "number", "s", "for how long the teacher was watched"),
    Column("distance_ratio", "number", "", "truth: way of student over teacher, a second and body size; 1 is as far"),
)
"""What a mind made of a teacher. Columns marked (eea) are those of the paper's teacher model."""

SELVES: tuple[Column, ...] = (
    _RUN, _CELL, _TRIAL, _STUDENT,
    Column("robot", "text", "", "what the student's own body is called"),
    Column("commands", "whole", "", "how many motor commands it tried on itself"),
    Column("topology_right", "flag", "", "truth: whether every limb hangs where the self-model has it"),
    Column("angle_error_deg", "number", "deg", "truth: largest error of a mounting angle, if the topology is right"),
    Column("identifiable", "flag", "", "whether it takes every angle for known, of students with a posterior"),
    Column("posterior_holds_truth", "flag", "", "truth: whether the true body lies in the posterior"),
    Column("evaluations", "whole", "", "how many bodies it tried in its mind"),
    Column("damage", "text", "", "truth: what broke, such as 'limb_lost limb_b'"),
    Column("damage_found", "text", "", "what it believes broke, in the same words"),
    Column("damage_share", "number", "", "how likely it holds that, 0 to 1"),
    Column("damage_named_right", "flag", "", "truth: whether it named the limb that broke"),
    Column("damage_named_right_first", "flag", "", "truth: the same before it discovered itself anew"),
    Column("damage_kind_right", "flag", "", "truth: whether it knows lost from locked"),
    Column("damage_noticed_after", "whole", "", "after how many commands it noticed"),
    Column("alarm_withdrawn", "flag", "", "whether it took back a damage that it had believed"),
    Column("left_topology_right", "flag", "", "truth: whether what is left of its body hangs as it then believes"),
    Column("left_angle_error_deg", "number", "deg", "truth: largest error of a mounting angle of what is left"),
    Column("left_angle_error_deg_first", "number", "deg", "truth: the same before it discovered itself anew"),
    Column("left_identifiable", "flag", "", "whether it takes the angles of what is left for known"),
    Column("locked_error_deg", "number", "deg", "truth: error of the angle at which a joint is stuck"),
    Column("locked_error_deg_first", "number", "deg", "truth: the same before it discovered itself anew"),
)
"""What a mind came to believe of its own body."""

TRIALS: tuple[Column, ...] = (
    _RUN,
    Column("scenario", "text", "", "the scenario's name"),
    Column("hash", "text", "", "the scenario's content hash"),
    Column("seed", "whole", "", "the scenario's seed"),
    _CELL, _TRIAL,
    Column("state", "text", "", "'finished', 'failed', 'damaged', or 'missing': not computed yet"),
    Column("why", "text", "", "what is wrong with a failed or damaged trial"),
)
"""Which trials there are. The other tables have rows of the finished ones."""

CELLS: tuple[Column, ...] = (
    _RUN, _CELL,
    Column("place", "text", "", "what the cell changes: an axis of the sweep, or a place in the scenario"),
    Column("value", "text", "", "what stands there"),
    Column("number", "number", "", "the same as a number, if it is one"),
)
"""What cells say otherwise than the scenario, one row a change; join by ``run`` and ``cell``."""
# fmt: on

TABLES = {"verdicts": VERDICTS, "selves": SELVES, "trials": TRIALS, "cells": CELLS}


def listed() -> Iterator[dict[str, str]]:
    """Every column of every table as plain data."""
    for table, columns in TABLES.items():
        for column in columns:
            yield {"table": table, "column": column.name, **dict(zip(_ABOUT, column[1:], strict=True))}


_ABOUT = ("holds", "unit", "meaning")


def as_markdown() -> str:
    """Every column of every table as text for the documentation."""
    parts = []
    for table, columns in TABLES.items():
        lines = [f"| `{each.name}` | {each.kind} | {each.unit} | {each.meaning} |" for each in columns]
        parts.append(
            "\n".join(
                [f"### {table}", "", "| column | holds | unit | meaning |", "|---|---|---|---|", *lines]
            )
        )
    return "\n\n".join(parts) + "\n"
