"""Rolls over time: as the student saw them, as it rehearsed them in its mind, and as it performed them."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy.spatial.transform import Rotation

from testbed.bodies.morphology import Morphology
from testbed.report.motion import part_name
from testbed.report.reading import Array, Trial
from testbed.report.style import INK, OF_PART, styled
from testbed.student.moving.rolls import headings, roll_of, view_of
from testbed.world.placement import STUDENT

_NARROWEST = 20.0
"""Degrees that every panel shows at least, so that a part that hardly moves looks like one."""


@styled
def rolls_over_time(trial: Trial, teacher: str, student: Morphology) -> Figure | None:
    """A row a part: what the student saw and what its self-model did in the mind, and beside it what its body did.

    The right column is there only for the teacher that it imitated.
    """
    names = ("teacher_rolls", "self_rolls", "order", "motion_times")
    target, responses, order, times = (trial.array(f"{teacher}/{name}") for name in names)
    if target is None or responses is None or order is None or times is None:
        return None
    performed = performed_rolls(trial, student) if _imitated(trial, teacher) else None
    parts = responses.shape[2]
    figure = Figure(figsize=(7.4, 0.85 * parts + 0.75), layout="constrained")
    columns = 1 if performed is None else 2
    panels = np.reshape(figure.subplots(parts, columns, sharex="col", sharey="row"), (parts, columns))
    seconds = np.linspace(0, float(times[-1] - times[0]), len(target))
    for part, line in enumerate(panels):
        colour = OF_PART[part % len(OF_PART)]
        seen, rehearsed = target[:, order[part]], responses[-1, :, part]
        line[0].plot(seconds, np.degrees(rehearsed), color=colour, linewidth=2.4, alpha=0.8)
        line[0].plot(seconds, np.degrees(seen), color=INK, linewidth=1.0)
        if performed is not None:
            clock, rolls = performed
            own = rolls[:, part]
            own = own - round((float(np.median(own)) - float(np.median(seen))) / math.pi) * math.pi
            line[1].plot(clock, np.degrees(own), color=colour, linewidth=1.8)
            line[1].set_xlim(0, clock[-1])
        line[0].set_xlim(0, seconds[-1])
        line[0].set_ylabel(f"{part_name(part)}\nroll (°)", fontsize=8.5)
        line[0].yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 3, 4.5, 6, 9, 10]))
        low, high = line[0].get_ylim()
        wider = max(0.0, _NARROWEST - (high - low)) / 2
        line[0].set_ylim(low - wider, high + wider)
        for axes in line:
            axes.grid(axis="y")
    for axes, title in zip(panels[0], ("in its mind (thin: as it saw them)", "performed"), strict=False):
        axes.set_title(title, fontsize=9)
    for axes in panels[-1]:
        axes.set_xlabel("time (s)")
    return figure


def performed_rolls(trial: Trial, student: Morphology) -> tuple[Array, Array] | None:
    """What the student's body did while it imitated: (steps,) s, and (steps, k) rolls in motor order, rad.

    The body is looked at as the student imagines itself (Section 3.4.1), from where it lay at the start.
    """
    arrays = [trial.array(name) for name in ("perform/start_step", "perform/steps", "time/control_step")]
    base, joints = (trial.array(f"truth/{STUDENT}/{name}") for name in ("base", "joints"))
    if any(array is None for array in arrays) or base is None or joints is None:
        return None
    start, steps, step = (float(array) for array in arrays if array is not None)
    if steps < 2 or joints.shape[1] != len(student.joints):
        return None
    stretch = slice(int(start) - 1, int(start + steps))
    base, joints = base[stretch].astype(float), joints[stretch].astype(float)
    yaw = Rotation.from_quat(base[0, 3:]).as_euler("zyx")[0]
    right = Rotation.from_euler("z", yaw).apply(view_of(student)[0])
    rolls = np.unwrap(roll_of(headings(student, base, joints), right), axis=0)
    names = list(student.parts)
    order = [
        names.index(student.root),
        *(names.index(joint.child) for joint in student.joints.values()),
    ]
    return np.arange(len(base)) * step, rolls[:, order]


def _imitated(trial: Trial, teacher: str) -> bool:
    return any(row["chosen"] and row["teacher"] == teacher for row in trial.rows)
