"""The cells of a sweep: which there are, what they are called, and what each changes.

Nothing is merged here, so that thousands of cells cost little until they are run.
"""

from __future__ import annotations

import functools
import itertools
import json
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from testbed.errors import UserError
from testbed.scenario.sweep import Axis, Level, Sobol, SweepSpec, level_name
from testbed.scenario.variation import Place

CONTROL = "control"
_LONGEST_NAME = 200
_MOST_PROBES = 12  # values of an axis that a check looks at
_MOST_CORNERED = 3  # axes
_SWEEPS = TypeAdapter(dict[str, SweepSpec])


@dataclass(frozen=True)
class Change:
    """One place of the scenario with another value.

    Attributes:
        place: Where, keys joined by dots.
        value: What stands there.
        said: Where the sweep says so: below ``sweep:`` and the block's name.
    """

    place: str
    value: Any
    said: Place


@dataclass(frozen=True)
class Point:
    """A cell of a sweep.

    Attributes:
        cell: Its name.
        block: Of which block; a control that blocks share is the first one's.
        levels: The level of every axis by the axis's name; None where the control has none of that axis.
        changes: What is otherwise than in the scenario, the later ones stronger.
    """

    cell: str
    block: str
    levels: Mapping[str, Level | None]
    changes: tuple[Change, ...]

    @property
    def patch(self) -> dict[str, Any]:
        """The changes as a cell of a scenario's file states them."""
        patch: dict[str, Any] = {}
        for change in self.changes:
            *around, last = change.place.split(".")
            inner = patch
            for key in around:
                below = inner.get(key)
                inner[key] = dict(below) if isinstance(below, dict) else {}
                inner = inner[key]
            inner[last] = change.value
        return patch


@dataclass(frozen=True)
class Block:
    """A block of a sweep with its cells.

    Attributes:
        name: The block's name.
        spec: What the file says.
        control: The control, which is no point of its own even where the design has it.
        points: All other cells.
    """

    name: str
    spec: SweepSpec
    control: Point
    points: tuple[Point, ...]

    @property
    def axes(self) -> dict[str, Axis]:
        """The axes by their names."""
        return {self.spec.name_of(key): axis for key, axis in self.spec.over.items()}

    def probes(self) -> list[Point]:
        """The control and some other cells that have every value between them, for a check that cannot look at all.

        For each value of each axis that point which is most like the control, and the corners of up to three axes.
        """
        listed = {name: _levels_of(axis) for name, axis in self.axes.items()}
        ends = {name: (levels[0], levels[-1]) for name, levels in listed.items()}
        wanted = {(name, level) for name, levels in listed.items() for level in _thinned(levels)}
        nearest: dict[tuple[str, Level | None], tuple[int, Point]] = {}
        found: dict[str, Point] = {}
        for point in self.points:
            apart = sum(point.levels[name] != self.control.levels[name] for name in listed)
            for key in wanted & set(point.levels.items()):
                if key not in nearest or apart < nearest[key][0]:
                    nearest[key] = (apart, point)
            if len(ends) <= _MOST_CORNERED and all(point.levels[name] in ends[name] for name in ends):
                found[point.cell] = point
        found |= {point.cell: point for _, point in nearest.values()}
        return [self.control, *(found.values() or self.points[:_MOST_PROBES])]


@dataclass(frozen=True)
class Sweep:
    """All blocks of a sweep by name."""

    blocks: Mapping[str, Block]

    @functools.cached_property
    def points(self) -> Mapping[str, Point]:
        """The cells by name, each block's control before its other points."""
        blocks = self.blocks.values()
        return {point.cell: point for block in blocks for point in (block.control, *block.points)}


def expanded(sweep: Mapping[str, SweepSpec], seed: int, template: Mapping[str, Any]) -> Sweep:
    """A sweep with its cells.

    Args:
        sweep: The blocks.
        seed: The scenario's; space-filling designs follow from it.
        template: The scenario without its sweep, as plain data.

    Raises:
        UserError: If two cells are called the same, or a name is too long.
    """
    known = {
        name: {key: _standing(template, key) for key, axis in block.over.items() if not axis.of}
        for name, block in sweep.items()
    }
    text = _SWEEPS.dump_json(dict(sweep)).decode()
    return _expanded(text, seed, json.dumps(known))


@functools.lru_cache(maxsize=8)  # the same few sweeps are asked for cell after cell
def _expanded(text: str, seed: int, known: str) -> Sweep:
    sweep, standing = _SWEEPS.validate_json(text), json.loads(known)
    blocks: dict[str, Block] = {}
    taken: set[str] = set()
    for name, spec in sweep.items():
        same = next((block for block in blocks.values() if block.spec.control == spec.control), None)
        control = _control(name, spec, standing[name], alone=len(sweep) == 1)
        if same is not None:
            control = Point(same.control.cell, same.name, control.levels, control.changes)
        prefix = f"{name}-" if len(sweep) > 1 else ""
        points = tuple(_points(name, prefix, spec, control, seed))
        for cell in [point.cell for point in points] + [control.cell] * (same is None):
            if cell in taken:
                raise UserError(
                    f"two cells of the sweep are called '{cell}'", "name the values: {a: ..., b: ...}"
                )
            if len(cell) > _LONGEST_NAME:
                what = f"the cell '{cell[:40]}...' has a name of {len(cell)} letters"
                raise UserError(what, "give the axes shorter names with 'name:'")
            taken.add(cell)
        blocks[name] = Block(name, spec, control, points)
    return Sweep(blocks)


def _control(name: str, spec: SweepSpec, standing: Mapping[str, Any], *, alone: bool) -> Point:
    levels: dict[str, Level | None] = {}
    changes: list[Change] = []
    used: set[str] = set()
    for key, axis in spec.over.items():
        said = next((one for one in (key, spec.name_of(key)) if one in spec.control), None)
        if said is None:
            levels[spec.name_of(key)] = None if axis.of else _level(axis, standing[key])
            continue
        used.add(said)
        value = spec.control[said]
        named = isinstance(axis.values, dict) and isinstance(value, str) and value in axis.values
        if named and isinstance(axis.values, dict):
            levels[spec.name_of(key)], value = value, axis.values[value]
        else:
            levels[spec.name_of(key)] = _level(axis, value)
        changes += _changes(key, axis, value, ("control", said))
    others = [Change(key, value, ("control", key)) for key, value in spec.control.items() if key not in used]
    cell = CONTROL if alone or not spec.control else f"{name}-{CONTROL}"
    return Point(cell, name, levels, (*others, *changes))


def _points(name: str, prefix: str, spec: SweepSpec, control: Point, seed: int) -> Iterator[Point]:
    for label, chosen in _designed(name, spec, control, seed):
        levels = {**control.levels, **{spec.name_of(key): level for key, (level, _) in chosen.items()}}
        if levels == control.levels and None not in levels.values():
            continue  # this is the control
        changes = [
            change
            for key, (_, value) in chosen.items()
            for change in _changes(key, spec.over[key], value, ("over", key))
        ]
        yield Point(f"{prefix}{label}", name, levels, (*control.changes, *changes))


Chosen = dict[str, tuple[Level, Any]]


def _designed(name: str, spec: SweepSpec, control: Point, seed: int) -> Iterator[tuple[str, Chosen]]:
    """The points of a design: what each is called, and the level and value of each axis that it sets."""
    if spec.design == "grid":
        for row in itertools.product(*(axis.levels() for axis in spec.over.values())):
            chosen = dict(zip(spec.over, row, strict=True))
            yield "+".join(_told(spec, key, level) for key, (level, _) in chosen.items()), chosen
    elif spec.design == "axes":
        for key, axis in spec.over.items():
            for level, value in axis.levels():
                if level != control.levels[spec.name_of(key)]:
                    yield _told(spec, key, level), {key: (level, value)}
    else:
        label = "sobol" if isinstance(spec.design, Sobol) else "latin"
        for number, row in enumerate(_filling(name, spec, seed)):
            yield (
                f"{label}_{number:04d}",
                {
                    key: _at(axis, float(share))
                    for (key, axis), share in zip(spec.over.items(), row, strict=True)
                },
            )


def _filling(name: str, spec: SweepSpec, seed: int) -> Any:
    from scipy.stats import qmc  # slow to load

    rng = np.random.default_rng([seed, zlib.crc32(f"sweep/{name}".encode())])
    if isinstance(spec.design, Sobol):
        whole = (
            spec.count - 1
        ).bit_length()  # it is balanced at powers of two; a beginning is a beginning of more
        return qmc.Sobol(len(spec.over), rng=rng).random_base2(whole)[: spec.count]
    return qmc.LatinHypercube(len(spec.over), rng=rng).random(spec.count)


def _at(axis: Axis, share: float) -> tuple[Level, Any]:
    if axis.ends is not None and axis.steps is None:
        number = axis.at(share)
        return number, number
    levels = axis.levels()
    return levels[min(int(share * len(levels)), len(levels) - 1)]


def _told(spec: SweepSpec, key: str, level: Level) -> str:
    return f"{spec.name_of(key)}_{level_name(level)}"


def _changes(key: str, axis: Axis, value: Any, said: Place) -> list[Change]:
    if not axis.of:
        return [Change(key, value, said)]
    return [Change(place, float(value) * factor, (*said, "of", place)) for place, factor in axis.of.items()]


def _level(axis: Axis, value: Any) -> Level | None:
    """The level of a value: its own, that of an equal listed value, or none."""
    for level, listed in axis.levels() if axis.values else ():
        if listed == value and isinstance(listed, bool) == isinstance(value, bool):
            return level
    return value if isinstance(value, str | int | float | bool) else None


def _levels_of(axis: Axis) -> list[Level]:
    return [level for level, _ in axis.levels()]


def _thinned(levels: list[Level]) -> list[Level]:
    """All levels, or some evenly spread ones, the ends among them."""
    if len(levels) <= _MOST_PROBES or not all(isinstance(level, int | float) for level in levels):
        return levels
    return [levels[round(at)] for at in np.linspace(0, len(levels) - 1, _MOST_PROBES)]


def _standing(data: Any, place: str) -> Any:
    """What stands at a place; None where there is nothing, or teachers have different things there."""
    first, _, rest = place.partition(".")
    if not first:
        return data
    if first == "all" and isinstance(data, list):
        found = [_standing(one, rest) for one in data]
        return found[0] if found and all(one == found[0] for one in found) else None
    if isinstance(data, list) and first.isdigit() and int(first) < len(data):
        return _standing(data[int(first)], rest)
    return _standing(data[first], rest) if isinstance(data, dict) and first in data else None
