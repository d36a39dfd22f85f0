"""Pydantic's complaints in the words of someone who has the file open in an editor."""

from __future__ import annotations

import functools
import re
from typing import Any, Protocol

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from testbed.errors import UserError, did_you_mean, shown_value

Place = tuple[str | int, ...]
Schema = dict[str, Any]

_MISTAKE = "mistake"
_RANGE_ERRORS = {"greater_than", "greater_than_equal", "less_than", "less_than_equal"}
_EXPECTED = {
    "float_type": ("a number", "write it as 12, 0.5 or 1e-3, without quotes or a unit"),
    "int_type": ("a whole number", "write it as 12, without a point, quotes or a unit"),
    "int_from_float": ("a whole number", "write it as 12, without a point, quotes or a unit"),
    "bool_type": ("true or false", "write true or false"),
    "string_type": ("text", "put it in quotes"),
    "tuple_type": ("a list", "write it as [a, b] or as lines that start with '- '"),
    "list_type": ("a list", "write it as [a, b] or as lines that start with '- '"),
    "dict_type": ("a mapping of names", "write 'name: value' lines below it"),
    "model_type": ("a mapping", "write 'key: value' lines below it"),
    "model_attributes_type": ("a mapping", "write 'key: value' lines below it"),
}


class Lines(Protocol):
    """What :class:`testbed.documents.Source` offers: errors with a file and a line."""

    def line(self, place: Place) -> int | None:
        """The line of a place, or of the nearest thing around it that the file has."""

    def error(self, place: Place, what: str, mend: str = "") -> UserError:
        """An error about a place in this file."""


def mistake(what: str, mend: str, *, at: str = "") -> PydanticCustomError:
    """An error for a validator to raise: what is wrong, how to mend it, and the key (``a.b``) it is about."""
    # The text is an argument and not the template: braces in a user's text must not be filled in.
    return PydanticCustomError(_MISTAKE, "{what}; {mend}", {"what": what, "mend": mend, "at": at})


def translate(model: type[BaseModel], data: object, source: Lines, error: ValidationError) -> UserError:
    """The most telling of the errors as a :class:`UserError`, with the number of the others."""
    schema = _schema_of(model)
    details = error.errors(include_url=False)
    # An unknown key is often the cause of other errors (the right key is then missing), so it goes first.
    first = min(
        details, key=lambda one: (one["type"] != "extra_forbidden", source.line(_place(one, data)) or 0)
    )
    place = _place(first, data)
    what, mend = _words(first, place, schema)
    if len(details) > 1:
        mend = f"{mend} (and {len(details) - 1} more)"
    return source.error(place, what, mend)


@functools.cache
def _schema_of(model: type[BaseModel]) -> Schema:
    return model.model_json_schema()


def place_name(place: Place) -> str:
    """``("teachers", 0, "gait")`` as ``teachers[0].gait``."""
    text = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in place)
    return text.removeprefix(".")


def _place(detail: ErrorDetails, data: object) -> Place:
    """Pydantic's location without the tags of unions, which are not in the file."""
    place: list[str | int] = []
    at = str(detail.get("ctx", {}).get("at", "")) if detail["type"] == _MISTAKE else ""
    location = (*detail["loc"], *at.split(".")) if at else detail["loc"]
    last = len(location) - 1
    for index, key in enumerate(location):
        if isinstance(data, list) and isinstance(key, str) and key.isdigit():
            key = int(key)  # from a mistake's 'at'
        if (isinstance(data, dict) and key in data) or (isinstance(data, list) and key in range(len(data))):
            place.append(key)
            data = data[key]  # type: ignore[index]
        elif index == last and (detail["type"] == "missing" or isinstance(key, int)):
            place.append(key)
    return tuple(place)


def _words(detail: ErrorDetails, place: Place, schema: Schema) -> tuple[str, str]:
    kind, value, context = detail["type"], detail["input"], detail.get("ctx", {})
    name = place_name(place) or "the file"
    around = place_name(place[:-1])
    if kind == _MISTAKE:
        return str(context["what"]), str(context["mend"])
    if kind == "extra_forbidden":
        known = list(_schema_at(schema, place[:-1]).get("properties", {}))
        what = f"unknown key '{place[-1]}'" + (f" in {around}" if around else "")
        return what, did_you_mean(str(place[-1]), known, kind="keys")
    if kind == "missing":
        if isinstance(place[-1], int):
            count = _schema_at(schema, place[:-1]).get("minItems", place[-1] + 1)
            return f"{around} has too few values", f"give {count}"
        return (
            f"{around} has no '{place[-1]}'" if around else f"'{place[-1]}' is missing"
        ), f"add '{place[-1]}: ...'"
    if kind in _RANGE_ERRORS:
        return _range_words(name, value, _schema_at(schema, place), str(place[-1]) if place else "")
    if kind in _EXPECTED:
        expected, mend = _EXPECTED[kind]
        if value is None:
            mend = "write it after the colon" if kind == "string_type" else mend
            needed = bool(place) and place[-1] in _schema_at(schema, place[:-1]).get("required", [])
            return f"{name} has no value where {expected} is expected", mend + (
                "" if needed else ", or remove the key"
            )
        return f"{name} must be {expected}, not {shown_value(value)}", mend
    if kind == "union_tag_invalid":
        name, value = f"{name}.{str(context['discriminator']).strip(chr(39))}", context["tag"]
    if kind in {"literal_error", "enum", "union_tag_invalid"}:
        expected = str(context.get("expected", context.get("expected_tags", "")))
        words = [word.strip().strip("'") for word in expected.replace(" or ", ", ").split(",")]
        return f"{name} cannot be {shown_value(value)}", did_you_mean(str(value), words, kind="values")
    if kind == "union_tag_not_found":
        tag = str(context.get("discriminator", "'kind'")).strip("'")
        return f"{name} has no '{tag}'", f"add '{tag}: ...'"
    if kind in {"too_short", "too_long"}:
        return _length_words(name, value, context)
    if kind == "string_pattern_mismatch":
        return (
            f"{name} cannot be {shown_value(value)}",
            "start with a letter and go on with letters, digits, '_' or '-'",
        )
    message = detail["msg"].removeprefix("Value error, ")
    what, _, mend = message.partition("; ")
    return f"{name}: {what}", mend or "see the documentation of this key"


def _length_words(name: str, value: object, context: dict[str, Any]) -> tuple[str, str]:
    count = len(value) if isinstance(value, list | dict | str) else context.get("actual_length", "?")
    if "min_length" in context:
        least = context["min_length"]
        if count == 0:
            return f"{name} is empty", f"give at least {least}"
        return f"{name} has {count} values", f"give at least {least}"
    return f"{name} has {count} values", f"give at most {context.get('max_length')}"


def _range_words(name: str, value: object, schema: Schema, key: str) -> tuple[str, str]:
    unit = _unit(schema, key)
    low, above = schema.get("minimum"), schema.get("exclusiveMinimum")
    high, below = schema.get("maximum"), schema.get("exclusiveMaximum")
    if low is not None and high is not None:
        span = f"between {_number(low)} and {_number(high)}"
    else:
        bounds = (("at least", low), ("above", above), ("at most", high), ("below", below))
        span = " and ".join(f"{word} {_number(bound)}" for word, bound in bounds if bound is not None)
    what = f"{name} must be {span}{f' {unit}' if unit else ''}, not {shown_value(value)}"
    top = high if high is not None else below
    bottom = low if low is not None else above
    if unit == "m" and isinstance(value, int | float) and top is not None and value > top:
        for small, factor in (("cm", 100), ("mm", 1000)):
            if (bottom or 0) <= value / factor <= top:
                return what, f"lengths are in metres; did you mean {value / factor:g} ({value:g} {small})?"
        return what, "lengths are in metres"
    return what, "choose a value in this range"


def _number(value: float) -> str:
    return str(int(value)) if float(value).is_integer() else f"{value:g}"


def _unit(schema: Schema, key: str) -> str:
    if "unit" in schema:
        return str(schema["unit"])
    if key.endswith("_deg"):
        return "degrees"
    return "m" if str(schema.get("description", "")).startswith("metres") else ""


def _schema_at(schema: Schema, place: Place) -> Schema:
    """The JSON schema of a place; empty where the schema does not say."""
    branches = _branches(schema, schema)
    for key in place:
        branches = [leaf for branch in branches for leaf in _branches(_step(branch, key), schema)]
    merged: Schema = {}
    for branch in branches:
        properties = {**merged.get("properties", {}), **branch.get("properties", {})}
        merged = {**branch, **merged}
        if properties:
            merged["properties"] = properties
    return merged


def _step(schema: Schema, key: str | int) -> Schema:
    if isinstance(key, int):
        prefix = schema.get("prefixItems", [])
        found = prefix[key] if key < len(prefix) else schema.get("items", {})
    else:
        named = schema.get("patternProperties", {}).items()  # of a dict whose keys have a form
        other = next((inner for form, inner in named if re.search(form, key)), None)
        other = schema.get("additionalProperties", {}) if other is None else other
        found = schema.get("properties", {}).get(key, other)
    return found if isinstance(found, dict) else {}


def _branches(schema: Schema, root: Schema) -> list[Schema]:
    """The schema with references followed and unions split."""
    if "$ref" in schema:
        target = root["$defs"][str(schema["$ref"]).rsplit("/", 1)[-1]]
        rest = {key: value for key, value in schema.items() if key != "$ref"}
        return _branches({**target, **rest}, root)
    for union in ("anyOf", "oneOf"):
        if union in schema:
            return [branch for option in schema[union] for branch in _branches(option, root)]
    if len(schema.get("allOf", [])) == 1:
        rest = {key: value for key, value in schema.items() if key != "allOf"}
        return _branches({**schema["allOf"][0], **rest}, root)
    return [schema]
