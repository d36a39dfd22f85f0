"""Chance in scenarios: any number, robot or block of a scenario file may be a distribution, drawn for each trial.

``{uniform: [0.8, 1.8]}``, ``{log_uniform: [0.5, 2]}``, ``{normal: [mean, sd]}`` (never beyond three standard
deviations) and ``{choice: [...]}`` stand where the value would stand; the options of a choice may be anything, with
distributions in them again. A new distribution is one class below and its key in ``DISTRIBUTIONS``.

Below the keys ``random`` and ``reality_gap`` a distribution is drawn for each joint or part by itself, and by those
who know the body; here they are left alone.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from typing import Any, cast

import numpy as np
from pydantic import Field, ValidationError, model_validator

from testbed.document_errors import mistake
from testbed.scenario.base import Spec

Place = tuple[str | int, ...]
DRAWN_ELSEWHERE = ("random", "reality_gap")
_MOST_SD = 3.0


class Distribution(Spec):
    """What a value may be."""

    def draw(self, rng: np.random.Generator) -> Any:
        """One value."""
        raise NotImplementedError

    @property
    def middle(self) -> Any:
        """A value that stands for all."""
        raise NotImplementedError

    @property
    def ends(self) -> tuple[Any, ...]:
        """The values between which all others lie, or all values."""
        raise NotImplementedError


class Uniform(Distribution):
    """Every number between two is as likely as any other."""

    uniform: tuple[float, float]

    @model_validator(mode="after")
    def _rising(self) -> Uniform:
        low, high = self.uniform
        if low > high:
            raise mistake(f"uniform goes from {low:g} to {high:g}", "write the smaller number first")
        return self

    def draw(self, rng: np.random.Generator) -> float:
        """One value."""
        return float(rng.uniform(*self.uniform))

    @property
    def middle(self) -> float:
        """The mean."""
        return sum(self.uniform) / 2

    @property
    def ends(self) -> tuple[float, ...]:
        """Both bounds."""
        return self.uniform


class LogUniform(Distribution):
    """Every factor is as likely as any other: half as often reaches as far down as twice reaches up."""

    log_uniform: tuple[float, float]

    @model_validator(mode="after")
    def _rising(self) -> LogUniform:
        low, high = self.log_uniform
        if not 0 < low <= high:
            what = f"log_uniform goes from {low:g} to {high:g}"
            raise mistake(what, "write two numbers above 0, the smaller first")
        return self

    def draw(self, rng: np.random.Generator) -> float:
        """One value."""
        low, high = self.log_uniform
        return float(min(max(math.exp(rng.uniform(math.log(low), math.log(high))), low), high))

    @property
    def middle(self) -> float:
        """The geometric mean."""
        return math.sqrt(math.prod(self.log_uniform))

    @property
    def ends(self) -> tuple[float, ...]:
        """Both bounds."""
        return self.log_uniform


class Normal(Distribution):
    """Mean and standard deviation; what lies beyond three of them is moved there."""

    normal: tuple[float, float]

    @model_validator(mode="after")
    def _wide(self) -> Normal:
        if self.normal[1] < 0:
            raise mistake(f"the standard deviation is {self.normal[1]:g}", "write [mean, sd], sd at least 0")
        return self

    def draw(self, rng: np.random.Generator) -> float:
        """One value."""
        mean, sd = self.normal
        return mean + sd * float(np.clip(rng.standard_normal(), -_MOST_SD, _MOST_SD))

    @property
    def middle(self) -> float:
        """The mean."""
        return self.normal[0]

    @property
    def ends(self) -> tuple[float, ...]:
        """Three standard deviations to either side."""
        mean, sd = self.normal
        return mean - _MOST_SD * sd, mean + _MOST_SD * sd


class Choice(Distribution):
    """One of several values, each as likely as any other; what stands twice is twice as likely."""

    choice: tuple[Any, ...] = Field(min_length=1)

    def draw(self, rng: np.random.Generator) -> Any:
        """One value."""
        return self.choice[int(rng.integers(len(self.choice)))]

    @property
    def middle(self) -> Any:
        """The first value."""
        return self.choice[0]

    @property
    def ends(self) -> tuple[Any, ...]:
        """All values."""
        return self.choice


Spread = float | Uniform | LogUniform | Normal
"""A number, or a distribution of numbers that is drawn for each joint or part by itself."""

DISTRIBUTIONS: dict[str, type[Distribution]] = {
    "uniform": Uniform,
    "log_uniform": LogUniform,
    "normal": Normal,
    "choice": Choice,
}


def is_distribution(value: object) -> bool:
    """Whether plain data are a distribution."""
    return isinstance(value, dict) and len(value) == 1 and next(iter(value)) in DISTRIBUTIONS


def distribution_of(value: object, place: Place) -> Distribution:
    """The distribution that plain data describe.

    Raises:
        PydanticCustomError: If it is none; the error says at which place.
    """
    kind = next(iter(cast(dict[str, object], value)))
    try:
        return DISTRIBUTIONS[kind].model_validate(value)
    except ValidationError as error:
        detail = error.errors(include_url=False)[0]
        context = detail.get("ctx", {})
        at = ".".join(map(str, place))
        if "what" in context:
            raise mistake(context["what"], context["mend"], at=at) from None
        mend = "write e.g. {choice: [crawler, splayed]}" if kind == "choice" else f"write {{{kind}: [a, b]}}"
        raise mistake(
            f"{kind} needs {'values' if kind == 'choice' else 'two numbers'}", mend, at=at
        ) from None


def value_of(spread: Spread, rng: np.random.Generator) -> float:
    """A number, drawn where it is a distribution."""
    return float(spread.draw(rng)) if isinstance(spread, Distribution) else float(spread)


def plain(data: object) -> Any:
    """Plain data with lists for tuples, as JSON has them."""
    if isinstance(data, dict):
        return {key: plain(value) for key, value in data.items()}
    return [plain(value) for value in data] if isinstance(data, tuple | list) else data


def varied(data: object, place: Place = ()) -> dict[Place, Any]:
    """The outermost distributions of plain data by their place."""
    if is_distribution(data):
        for end in distribution_of(data, place).ends:
            varied(end, place)  # finds mistakes
        return {place: plain(data)}
    return {found: raw for key, value in _items(data) for found, raw in varied(value, (*place, key)).items()}


def middle(data: object, place: Place = ()) -> Any:
    """The data with a middle value for every distribution."""
    if is_distribution(data):
        return middle(distribution_of(data, place).middle, place)
    return _rebuilt(data, {key: middle(value, (*place, key)) for key, value in _items(data)})


def realised(data: object, rng: np.random.Generator) -> Any:
    """The data with a drawn value for every distribution."""
    if is_distribution(data):
        return realised(distribution_of(data, ()).draw(rng), rng)
    return _rebuilt(data, {key: realised(value, rng) for key, value in _items(data)})


def corners(data: object) -> Iterator[Any]:
    """The data at the ends of each distribution, the others in their middle: one end after the other."""
    for place, raw in varied(data).items():
        for end in distribution_of(raw, place).ends:
            for corner in (middle(end), *corners(end)):
                yield replaced(middle(data), place, corner)


def replaced(data: object, place: Place, value: object) -> Any:
    """The data with another value at a place that exists."""
    if not place:
        return value
    return _rebuilt(
        data,
        {
            key: replaced(old, place[1:], value) if str(key) == str(place[0]) else old
            for key, old in _items(data)
        },
    )


def chance(seed: int, trial: int, place: Place) -> np.random.Generator:
    """The generator of one place in one trial: what happens elsewhere in the scenario does not touch it."""
    return np.random.default_rng([seed, trial, zlib.crc32(spelled(place).encode())])


def spelled(place: Place) -> str:
    """``("teachers", 0, "distance")`` as ``teachers/0/distance``."""
    return "/".join(map(str, place))


def place_of(text: str) -> Place:
    """The inverse of :func:`spelled`."""
    return tuple(int(key) if key.isdigit() else key for key in text.split("/"))


def _items(data: object) -> list[tuple[str | int, Any]]:
    if isinstance(data, dict):
        return [(key, value) for key, value in data.items() if key not in DRAWN_ELSEWHERE]
    return list(enumerate(data)) if isinstance(data, list | tuple) else []


def _rebuilt(data: object, values: dict[str | int, Any]) -> Any:
    if isinstance(data, dict):
        return {**data, **values}
    return type(data)(values.values()) if isinstance(data, list | tuple) else data
