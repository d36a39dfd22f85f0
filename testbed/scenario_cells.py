"""Cells: variants of a scenario, each said by what it changes.

::

    cells:
      control: {}
      far: {teachers: {all: {distance: 1.8}}}
      noise: {rig: {camera_noise: 6}}

A cell has the scenario's own keys, merged deeply: mappings key by key, teachers one by one (a list, or a mapping with
``all`` for everybody and ``0``, ``1``, ... for one of them); anything else, distributions and another ``kind`` of
gait included, takes the place of what was there. Cells of a trial draw alike what they do not change.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from testbed.documents import Document, Source, validate
from testbed.errors import did_you_mean
from testbed.scenario_specs import Scenario
from testbed.scenario_variation import Place, is_distribution

ONLY_CELL = "default"
"""What the cell of a scenario without cells is called."""

_SHARED = ("name", "seed", "cells", "variation")


def cell_names(scenario: Scenario) -> tuple[str, ...]:
    """The scenario's cells, in order; ``default`` alone if it has none."""
    return tuple(scenario.cells) or (ONLY_CELL,)


def in_cell(scenario: Scenario, cell: str) -> Scenario:
    """The scenario as one of its cells has it; it has no cells of its own.

    Raises:
        UserError: If there is no such cell, or what it says is wrong; with its line in the scenario's file.
    """
    if not scenario.cells and cell == ONLY_CELL:
        return scenario
    source = scenario.source
    if cell not in scenario.cells:
        raise source.error(("cells",), f"there is no cell '{cell}'", did_you_mean(cell, cell_names(scenario)))
    changes = scenario.cells[cell]
    for key in _SHARED:
        if key in changes:
            what = f"cell '{cell}' cannot have a {key} of its own"
            raise source.error(("cells", cell, key), what, "all cells share it; say it outside of 'cells:'")
    base = scenario.template
    _check_teachers(changes.get("teachers"), len(base["teachers"]), cell, source)
    merged = {**_merged(base, changes), "cells": {}}
    lines = _lines(source, cell, len(merged["teachers"]) if isinstance(merged["teachers"], list) else 0)
    variant = validate(Scenario, Document(merged, Source(source.file, lines)))
    variant._source = Source(source.file, lines)
    return variant


def _check_teachers(changes: Any, count: int, cell: str, source: Source) -> None:
    if isinstance(changes, dict) and not is_distribution(changes):
        known = ["all", *map(str, range(count))]
        for key in changes:
            if key not in known:
                what = f"cell '{cell}' changes teacher '{key}', whom the scenario does not have"
                raise source.error(("cells", cell, "teachers", key), what, did_you_mean(key, known))


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


def _lines(source: Source, cell: str, teachers: int) -> dict[Place, int]:
    """The lines of the merged scenario's places: those of the cell where it says something."""
    lines = dict(source.lines)
    within = {place[2:]: line for place, line in source.lines.items() if place[:2] == ("cells", cell)}
    for place, line in within.items():
        for target in _targets(place, teachers):
            lines[target] = line
    return lines


def _targets(place: Place, teachers: int) -> Iterator[Place]:
    if place[:1] == ("teachers",) and len(place) > 1:
        which = range(teachers) if place[1] == "all" else [int(place[1])] if str(place[1]).isdigit() else []
        yield from (("teachers", index, *place[2:]) for index in which)
    elif place:
        yield place
