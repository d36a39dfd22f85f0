"""Cells: variants of a scenario, each said by what it changes.

::

    cells:
      control: {}
      far: {teachers: {all: {distance: 1.8}}}
      noise: {rig: {camera_noise: 6}}

A cell has the scenario's own keys, merged deeply: mappings key by key, teachers one by one (a list, or a mapping with
``all`` for everybody and ``0``, ``1``, ... for one of them); anything else, distributions and another ``kind`` of
gait included, takes the place of what was there. Cells of a trial draw alike what they do not change.

The cells of a ``sweep:`` are those of its design (:mod:`testbed.scenario.sweep`), merged when they are asked for.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from testbed.documents import Document, Source, validate
from testbed.errors import UserError, did_you_mean
from testbed.scenario.points import Point, Sweep, expanded
from testbed.scenario.specs import Scenario
from testbed.scenario.sweep import UNNAMED
from testbed.scenario.variation import Place, is_distribution

ONLY_CELL = "default"
"""What the cell of a scenario without cells is called."""

_SHARED = ("name", "seed", "cells", "sweep", "split", "splits", "variation")


def cell_names(scenario: Scenario) -> tuple[str, ...]:
    """The scenario's cells, in order; ``default`` alone if it has none."""
    if scenario.sweep:
        return tuple(sweep_of(scenario).points)
    return tuple(scenario.cells) or (ONLY_CELL,)


def sweep_of(scenario: Scenario) -> Sweep:
    """The blocks and cells of the scenario's sweep; none where it sweeps nothing.

    Raises:
        UserError: If its cells cannot be told apart.
    """
    try:
        return expanded(scenario.sweep, scenario.seed, scenario.template) if scenario.sweep else Sweep({})
    except UserError as error:
        raise scenario.source.error(("sweep",), error.what, error.mend) from None


def probed_cells(scenario: Scenario) -> tuple[str, ...]:
    """Cells that a check looks at: all that are written out, and of a sweep some that have every value between them."""
    if not scenario.sweep:
        return cell_names(scenario)
    blocks = sweep_of(scenario).blocks.values()
    return tuple(dict.fromkeys(point.cell for block in blocks for point in block.probes()))


def may_be_left_out(scenario: Scenario, cell: str) -> bool:
    """Whether a cell that cannot be is left out: where its sweep says so, and never a control."""
    sweep = sweep_of(scenario)
    point = sweep.points.get(cell)
    if point is None or any(block.control.cell == cell for block in sweep.blocks.values()):
        return False
    return sweep.blocks[point.block].spec.impossible == "leave_out"


def trials_of(scenario: Scenario, cell: str) -> int:
    """How many trials a cell has; those of a sweep have as many as the scenario says."""
    return int(scenario.cells.get(cell, {}).get("trials", scenario.trials))


def mind_names(scenario: Scenario, cell: str) -> tuple[str, ...]:
    """Who judges in a cell, the student itself first."""
    point = sweep_of(scenario).points.get(cell)
    if point is not None and not any(
        change.place.startswith(("student", "beside")) for change in point.changes
    ):
        return tuple(mind.name for mind in scenario.minds)  # without merging thousands of cells
    return tuple(mind.name for mind in in_cell(scenario, cell).minds)


def in_cell(scenario: Scenario, cell: str) -> Scenario:
    """The scenario as one of its cells has it; it has no cells of its own.

    Raises:
        UserError: If there is no such cell, or what it says is wrong; with its line in the scenario's file.
    """
    if not scenario.cells and not scenario.sweep and cell == ONLY_CELL:
        return scenario
    source = scenario.source
    if scenario.sweep:
        point = sweep_of(scenario).points.get(cell)
        if point is not None:
            lines = _lines_of(point, source)
            return merged_scenario(scenario, point.patch, f"cell '{cell}'", lines, cells={}, sweep={})
    elif cell in scenario.cells:
        changes = scenario.cells[cell]
        for key in _SHARED:
            if key in changes:
                what = f"cell '{cell}' cannot have a {key} of its own"
                raise source.error(
                    ("cells", cell, key), what, "all cells share it; say it outside of 'cells:'"
                )
        lines = lines_within(source, ("cells", cell))
        return merged_scenario(scenario, changes, f"cell '{cell}'", lines, cells={}, sweep={})
    raise source.error(("cells",), f"there is no cell '{cell}'", did_you_mean(cell, cell_names(scenario)))


def split_names(scenario: Scenario) -> tuple[str, ...]:
    """What ``--split`` may ask for: the scenario as it stands first; nothing where it has no splits."""
    return (scenario.split, *scenario.splits) if scenario.split is not None else ()


def in_split(scenario: Scenario, split: str) -> Scenario:
    """The scenario as one of its splits has it.

    Raises:
        UserError: If there is no such split, or what it says is wrong; with its line in the scenario's file.
    """
    if split == scenario.split:
        return scenario
    source = scenario.source
    if split not in scenario.splits:
        known = split_names(scenario)
        mend = did_you_mean(split, known, kind="splits") if known else "the scenario has no 'splits:'"
        raise source.error(("splits",), f"there is no split '{split}'", mend)
    lines = lines_within(source, ("splits", split))
    return merged_scenario(
        scenario, scenario.splits[split], f"split '{split}'", lines, split=split, splits={}
    )


def merged_scenario(
    scenario: Scenario,
    changes: Mapping[str, Any],
    who: str,
    lines: Mapping[Place, int],
    **replaced: Any,
) -> Scenario:
    """The scenario with changes merged deeply into it; mistakes have the lines of the changes.

    Args:
        scenario: What is changed.
        changes: As a cell states them.
        who: Who changes it, for errors.
        lines: The line of each change by its place.
        replaced: Keys of the scenario that get these values and nothing merged.

    Raises:
        UserError: If what comes out is no scenario.
    """
    base, said = scenario.template, scenario.source
    around = {place[:end]: line for place, line in lines.items() for end in range(1, len(place))}
    own = Source(said.file, {**around, **said.lines, **lines})
    known = ["all", *map(str, range(len(base["teachers"])))]
    teachers = changes.get("teachers")
    for key in teachers if isinstance(teachers, dict) and not is_distribution(teachers) else ():
        if key not in known:
            what = f"{who} changes teacher '{key}', whom the scenario does not have"
            raise own.error(("teachers", key), what, did_you_mean(key, known))
    merged = {**_merged(base, dict(changes)), **replaced}
    count = len(merged["teachers"]) if isinstance(merged["teachers"], list) else 0
    everybody = {target: line for place, line in lines.items() for target in _targets(place, count)}
    source = Source(said.file, {**around, **said.lines, **everybody})
    variant = validate(Scenario, Document(merged, source))
    variant._source = source
    return variant


def lines_within(source: Source, around: Place) -> dict[Place, int]:
    """The lines of what stands below a place, by their places there."""
    depth = len(around)
    return {place[depth:]: line for place, line in source.lines.items() if place[:depth] == around}


def _merged(base: Any, changes: Any, key: str = "") -> Any:
    if key == "teachers" and isinstance(changes, dict) and not is_distribution(changes):
        for_all = changes.get("all", {})
        everybody = [_merged(teacher, for_all, "teacher") for teacher in base]
        return [_merged(one, changes.get(str(index), {}), "teacher") for index, one in enumerate(everybody)]
    if key == "teachers" and isinstance(changes, list):
        both = [_merged(old, new, "teacher") for old, new in zip(base, changes, strict=False)]
        return [*both, *base[len(changes) :], *changes[len(base) :]]
    if key == "student" and isinstance(changes, str):
        changes = {"method": changes}
    if not isinstance(base, dict) or not isinstance(changes, dict):
        return changes
    if (
        is_distribution(base)
        or is_distribution(changes)
        or base.get("kind") != changes.get("kind", base.get("kind"))
    ):
        return changes
    if "method" in changes and base.get("name") == base.get("method"):
        base = {
            inner: value for inner, value in base.items() if inner != "name"
        }  # it was only named after it
    return {**base, **{inner: _merged(base.get(inner), value, inner) for inner, value in changes.items()}}


def _lines_of(point: Point, source: Source) -> dict[Place, int]:
    """The lines of a point's changes, by the places in the scenario that they change."""
    lines: dict[Place, int] = {}
    for change in point.changes:
        place: Place = tuple(change.place.split("."))
        for around in ((), (UNNAMED,), (point.block,)):
            said = ("sweep", *around, *change.said)
            if said in source.lines:
                lines[place] = source.lines[said]
    return lines


def _targets(place: Place, teachers: int) -> Iterator[Place]:
    if place[:1] == ("teachers",) and len(place) > 1:
        which = range(teachers) if place[1] == "all" else [int(place[1])] if str(place[1]).isdigit() else []
        yield from (("teachers", index, *place[2:]) for index in which)
    elif place:
        yield place
