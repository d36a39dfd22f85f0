"""The set-up sheet of a trial: who stands where, on which board, before anything moves."""

from __future__ import annotations

import math

from testbed.bodies.morphology import load_robot
from testbed.hardware.bench_file import RIG, BenchSpec
from testbed.scenario import Scenario, drawn, in_cell
from testbed.world.bullet import bodies_of
from testbed.world.placement import placements, teacher_names

_WHEN = {"watched": "when watched", "always": "always", "answering": "in answer"}


def setup_rows(
    scenario: Scenario, trial: int, cell: str, spec: BenchSpec | None = None
) -> list[dict[str, str]]:
    """A row each: the student, the teachers in their order, and the rig.

    Args:
        scenario: The run's.
        trial: Which trial: what is left to chance differs between them.
        cell: Of which cell.
        spec: The bench, to tell which board is meant.
    """
    here = drawn(in_cell(scenario, cell), trial)
    bodies = bodies_of(here)
    spots = placements(here, bodies)
    gaits = {
        name: f"{teacher.gait.kind}, {_WHEN[teacher.gait.when]}"
        for name, teacher in zip(teacher_names(here), here.teachers, strict=True)
    }
    rows = []
    for name, body in bodies.items():
        x, y = spots[name].place
        rows.append(
            {
                "who": name,
                "robot": body.name,
                "board": _board(spec, name),
                "to the right": f"{100 * x:.1f} cm",
                "ahead": f"{100 * y:.1f} cm",
                "turned": f"{_turned(spots[name].yaw):.0f}°",
                "on": f"{100 * spots[name].height:.1f} cm" if spots[name].height else "the ground",
                "does": gaits.get(name, "learns"),
            }
        )
    rig = here.rig
    rows.append(
        {
            "who": RIG,
            "robot": "cameras",
            "board": _board(spec, RIG),
            "to the right": "0.0 cm",
            "ahead": "0.0 cm",
            "turned": "0°",
            "on": f"{100 * rig.height:.1f} cm",
            "does": f"pans {rig.pan_limit_deg:.0f}° to either side",
        }
    )
    return rows


def _board(spec: BenchSpec | None, name: str) -> str:
    if spec is None:
        return ""
    board = spec.boards.get(name)
    return "MISSING" if board is None else board.unique_id or str(board.port)


def _turned(yaw: float) -> float:
    """Degrees from 0 to 360, counter-clockwise seen from above, 0: its first limb's axis to the right."""
    return round(math.degrees(yaw)) % 360


def misfits(scenario: Scenario, spec: BenchSpec) -> list[str]:
    """What the scenario needs and the bench file does not have, in words; empty if it fits."""
    bodies = bodies_of(drawn(scenario, 0))
    found = [f"there is no board for {name}" for name in (*bodies, RIG) if name not in spec.boards]
    for name, body in bodies.items():
        board = spec.boards.get(name)
        if board is not None and (other := load_robot(board.robot).name) != body.name:
            found.append(f"{name} is a {body.name} in the scenario and a {other} on the bench")
    return found
