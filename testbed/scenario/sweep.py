"""Sweeps: many cells in few lines, as grids or space-filling designs over any parameter of the scenario.

::

    sweep:
      design: grid                  # or axes, {sobol: 64}, {latin_hypercube: 64}
      over:
        teachers.all.scale: [0.5, 1, 2]
        teachers.all.distance: {log_uniform: [0.45, 1.8], steps: 5}
      control: {teachers.all.distance: 0.9}

Every point of the design is a cell (:mod:`testbed.scenario.cells`) that every other is matched with: same trials, same
chances. The *control* is the scenario as it stands, with what ``control:`` says; all cells depart from it. Several
sweeps of a scenario are blocks by name, ``sweep: {size: {over: ...}, facing: {over: ...}}``.

An axis is a place in the scenario, its keys joined by dots, or a name with ``of:``, which moves several places
together: each is the axis's value times the number that stands there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from testbed.document_errors import mistake
from testbed.errors import did_you_mean
from testbed.scenario.base import Identifier, Spec
from testbed.scenario.variation import plain

UNNAMED = "sweep"
"""What the only block of a sweep is called."""

MOST_CELLS = 100_000
_SIGNIFICANT = 4  # digits of a value between two ends, so that names and files can be read
_SHARED = ("name", "description", "seed", "trials", "cells", "sweep", "split", "splits", "variation")
_DESIGNS = "grid, axes, {sobol: 64} or {latin_hypercube: 64}"
Count = Annotated[int, Field(ge=1, le=MOST_CELLS)]
Level = str | int | float | bool
"""A value of an axis as names, tables and pictures have it."""


class Sobol(Spec):
    """A scrambled Sobol sequence: fills the space evenly; more points continue fewer."""

    sobol: Count


class LatinHypercube(Spec):
    """Each axis is cut into as many slices as there are points, with one point in each."""

    latin_hypercube: Count


class Axis(Spec):
    """What is swept: listed values, or a range between two ends."""

    values: tuple[Any, ...] | dict[Identifier, Any] = Field(
        (), description="the values, or the values by name; a value may be a block, merged as a cell is"
    )
    uniform: tuple[float, float] | None = None
    log_uniform: tuple[float, float] | None = None
    steps: int | None = Field(None, ge=2, le=1000, description="how many values of the range a grid has")
    of: dict[str, float] = Field(default_factory=dict, description="places that move together, with factors")
    name: Identifier | None = Field(None, description="what tables call it; the place's last key by default")

    @model_validator(mode="before")
    @classmethod
    def _listed(cls, data: object) -> object:
        _check_keys(cls, data, "an axis")
        return {"values": tuple(data)} if isinstance(data, list | tuple) else data

    @field_validator("values")
    @classmethod
    def _plain_data(cls, values: tuple[Any, ...] | dict[str, Any]) -> tuple[Any, ...] | dict[str, Any]:
        if isinstance(values, dict):
            return {name: plain(value) for name, value in values.items()}
        return tuple(plain(value) for value in values)

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        given = [bool(self.values), self.uniform is not None, self.log_uniform is not None]
        if sum(given) != 1:
            raise mistake(
                "an axis has either values or one range",
                "write [a, b, c], {uniform: [a, b], steps: 5} or {log_uniform: [a, b], steps: 5}",
            )
        ends = self.ends
        if ends is not None and not (ends[0] < ends[1] and (self.uniform or ends[0] > 0)):
            what = f"the range goes from {ends[0]:g} to {ends[1]:g}"
            raise mistake(what, "write the smaller number first; with log_uniform both are above 0")
        if self.steps is not None and ends is None:
            raise mistake("steps are for a range", "leave 'steps:' out beside 'values:'", at="steps")
        if self.of and not all(isinstance(value, int | float) for value in self.values):
            raise mistake("an axis with 'of:' has numbers for values", "write [0, 0.5, 1]", at="values")
        names = [_named(level, number) for number, level in enumerate(self.values)]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise mistake(f"two values are called '{twice}'", "write each once, or by name: {a: ..., b: ...}")
        return self

    @property
    def ends(self) -> tuple[float, float] | None:
        """The ends of the range; None for listed values."""
        return self.uniform or self.log_uniform

    @property
    def logarithmic(self) -> bool:
        """Whether equal factors are equal steps: so it is with a logarithmic range, and with listed values like one."""
        numbers = [value for value in self.values if isinstance(value, int | float)]
        spread = len(numbers) > 2 and min(numbers) > 0 and max(numbers) / min(numbers) >= 4
        return self.log_uniform is not None or spread

    def levels(self) -> list[tuple[Level, Any]]:
        """Every value of a listed or stepped axis, with its level before it; the ends of a range without steps."""
        if isinstance(self.values, dict):
            return list(self.values.items())
        if self.values:
            scalar = (str, int, float, bool)
            return [
                (value if isinstance(value, scalar) else _named(value, number), value)
                for number, value in enumerate(self.values)
            ]
        steps = self.steps or 2
        numbers = [self.at(step / (steps - 1)) for step in range(steps)]
        return [(number, number) for number in numbers]

    def smoke(self) -> Axis:
        """Its last value alone."""
        level, value = self.levels()[-1]
        values = {level: value} if isinstance(self.values, dict) and isinstance(level, str) else (value,)
        whole = {"values": values, "uniform": None, "log_uniform": None, "steps": None}
        return self.model_copy(update=whole)

    def at(self, share: float) -> float:
        """The number that lies so far (0 to 1) along the range."""
        assert self.ends is not None
        low, high = self.ends
        if share in (0, 1):
            return high if share else low
        value = low + share * (high - low) if self.uniform else low * (high / low) ** share
        return min(max(float(f"{value:.{_SIGNIFICANT}g}"), low), high)


class SweepSpec(Spec):
    """One block of cells: a design over some axes, and the control that they are held against."""

    design: Literal["grid", "axes"] | Sobol | LatinHypercube = Field(
        "grid",
        description="grid: every combination; axes: each axis alone, the others as in the control; sobol and "
        "latin_hypercube: so many points that fill the space, following from the scenario's seed",
    )
    over: dict[str, Axis] = Field(min_length=1, max_length=16, description="the axes")
    control: dict[str, Any] = Field(
        default_factory=dict,
        description="places, or axes by name, in which the control differs from the file",
    )
    impossible: Literal["fail", "leave_out"] = Field(
        "fail",
        description="what becomes of a cell that cannot be, such as a body too large for the view: a failure, or left "
        "out and told as such; either way the others go on",
    )
    margin: float = Field(
        0.02, gt=0, lt=1, description="a loss of AUC or of right verdicts within this counts as none"
    )

    @field_validator("control")
    @classmethod
    def _plain_control(cls, control: dict[str, Any]) -> dict[str, Any]:
        return {key: plain(value) for key, value in control.items()}

    @model_validator(mode="before")
    @classmethod
    def _known_design(cls, data: object) -> object:
        _check_keys(cls, data, "a sweep")
        design = data.get("design", "grid") if isinstance(data, dict) else "grid"
        kinds = ("sobol", "latin_hypercube")
        known = design in ("grid", "axes") if isinstance(design, str) else isinstance(design, dict | Spec)
        if not known or (isinstance(design, dict) and (len(design) != 1 or next(iter(design)) not in kinds)):
            word = design if isinstance(design, str) else next(iter(design), "") if known else ""
            mend = did_you_mean(str(word), ("grid", "axes", *kinds), kind="designs")
            raise mistake(f"there is no such design; it is {_DESIGNS}", mend, at="design")
        return data

    @model_validator(mode="after")
    def _sound(self) -> Self:
        names: list[str] = []
        for key, axis in self.over.items():
            for place in axis.of or (key,):
                _check_place(place, f"over.{key}" if "." not in key else "over")
            names.append(self.name_of(key))
            if names.count(names[-1]) > 1:
                what = f"two axes are called '{names[-1]}'"
                raise mistake(what, "give one a 'name:', e.g. {values: [1, 2], name: second}", at="over")
            if self.listed and axis.ends is not None and axis.steps is None:
                what = f"axis '{key}' has no steps for a design of listed values"
                raise mistake(what, "add e.g. 'steps: 5'", at="over")
        if self.count > MOST_CELLS:
            what = f"the design has {self.count} cells"
            raise mistake(what, f"at most {MOST_CELLS}; a space-filling design needs fewer", at="design")
        for key in self.control:
            if key not in self.over and key not in names:
                _check_place(key, "control")
        return self

    def smoke(self) -> SweepSpec:
        """A single cell beside the control, or one an axis."""
        if self.design == "grid" or self.design == "axes":
            return self.model_copy(update={"over": {key: axis.smoke() for key, axis in self.over.items()}})
        one = Sobol(sobol=1) if isinstance(self.design, Sobol) else LatinHypercube(latin_hypercube=1)
        return self.model_copy(update={"design": one})

    @property
    def listed(self) -> bool:
        """Whether the design takes the axes' values as they are listed."""
        return isinstance(self.design, str)

    @property
    def count(self) -> int:
        """How many points the design has; one of them may be the control."""
        if isinstance(self.design, Sobol):
            return self.design.sobol
        if isinstance(self.design, LatinHypercube):
            return self.design.latin_hypercube
        levels = [len(axis.levels()) for axis in self.over.values()]
        return math.prod(levels) if self.design == "grid" else sum(levels)

    def name_of(self, key: str) -> str:
        """An axis's name."""
        return self.over[key].name or key.rsplit(".", 1)[-1]


def sweeps_by_name(data: object) -> object:
    """A single sweep as the only block; blocks by name as they are."""
    if isinstance(data, Mapping) and ("over" in data or "design" in data):
        return {UNNAMED: data}
    return data


def _named(value: object, number: int) -> str:
    """A value of an axis as part of a cell's name."""
    if isinstance(value, bool) or value is None:
        return str(value).lower()
    if isinstance(value, int | float):
        return f"{value:g}"
    if isinstance(value, str):
        stem = value.replace("\\", "/").rsplit("/", 1)[-1].removesuffix(".yaml")
        return "".join(letter if letter.isalnum() or letter in "_-." else "_" for letter in stem) or "_"
    return f"value_{number}"


def level_name(level: Level | None) -> str:
    """A level as part of a cell's name."""
    return _named(level, 0)


def _check_keys(model: type[Spec], data: object, what: str) -> None:
    """A short form of a file must not hide which keys there are."""
    for key in data if isinstance(data, dict) else ():
        if key not in model.model_fields:
            raise mistake(
                f"unknown key '{key}' in {what}", did_you_mean(key, model.model_fields, kind="keys"), at=key
            )


def _check_place(place: str, at: str) -> None:
    first, *rest = place.split(".")
    if first in _SHARED:
        raise mistake(f"{first} cannot be swept", "all cells share it; sweep what is in the world", at=at)
    if not rest and first not in ("student", "world", "rig", "beside"):
        mend = (
            "write a place such as teachers.all.scale or student.robot, or 'of:' with places below the name"
        )
        raise mistake(f"'{place}' is no place that can be swept", mend, at=at)
