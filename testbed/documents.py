"""YAML files read with care: plain data, the line of every value, and errors that say how to mend the file.

The files that people write (scenarios, robots) use a small and plain part of YAML: mappings, lists, text,
numbers, ``true``, ``false`` and ``null``. What surprises people in YAML 1.1 is left out: ``on`` and ``yes``
are text, ``1e-3`` is a number, ``1:30`` is text and not ninety; anchors, aliases and tags are refused.
"""

from __future__ import annotations

import math
import re
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from testbed.document_errors import Place, translate
from testbed.errors import UserError, did_you_mean, one_line

LARGEST_FILE = 1 << 18  # bytes; a scenario has a few kilobytes
LARGEST_INTEGER = 10**15  # beyond it a float no longer holds every whole number
DEEPEST_NESTING = 40

Model = TypeVar("Model", bound=BaseModel)

_INTEGER = re.compile(r"[-+]?(0|[1-9][0-9]*)\Z", re.ASCII)
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|(0|[1-9][0-9]*)(\.[0-9]*)?)([eE][-+]?[0-9]+)?\Z", re.ASCII)
_NOT_FINITE = re.compile(r"([-+]?\.?inf(inity)?|\.?nan)\Z", re.IGNORECASE)
_WORDS = {"true": True, "false": False, "null": None, "~": None, "": None}


@dataclass(frozen=True)
class Source:
    """Where data were read: the file and the line of each place. Two sources always compare equal."""

    # A scenario is what it says, not where it was read: nothing here takes part in comparison.
    file: Path | str | None = field(default=None, compare=False)
    lines: Mapping[Place, int] = field(default_factory=dict, compare=False)

    def line(self, place: Place) -> int | None:
        """The line of a place, or of the nearest thing around it that the file has."""
        for end in range(len(place), -1, -1):
            if place[:end] in self.lines:
                return self.lines[place[:end]]
        return None

    def error(self, place: Place, what: str, mend: str = "") -> UserError:
        """An error about a place in this file."""
        return UserError(what, mend, file=self.file, line=self.line(place))


@dataclass(frozen=True)
class Document:
    """A YAML file as plain data (dict, list, str, int, float, bool, None) and the line of every value."""

    data: dict[str, object]
    source: Source


def read_document(path: Path | str) -> Document:
    """Read a YAML file that holds a mapping.

    Raises:
        UserError: If there is no such file, it is no UTF-8 text, too large, malformed, or no mapping.
    """
    return parse_document(_text(Path(path)), path)


def parse_document(text: str, file: Path | str | None = None) -> Document:
    """Parse YAML text that holds a mapping; ``file`` is where it came from, for the errors.

    Raises:
        UserError: As :func:`read_document` does.
    """
    lines: dict[Place, int] = {}
    node = _compose(text, file)
    if node is None:
        raise UserError("the file is empty", "start with lines such as 'name: x'", file=file, line=1)
    if not isinstance(node, yaml.MappingNode):
        raise _at(node, file, "the file holds no 'key: value' lines", "start with lines such as 'name: x'")
    data = _plain(node, (), lines, file)
    assert isinstance(data, dict)
    return Document(data, Source(file, lines))


def validate(model: type[Model], document: Document) -> Model:
    """The document as an instance of a pydantic model.

    Values are taken as they are written: ``"0.9"`` in quotes is no number and ``1`` is no ``true``.

    Raises:
        UserError: For the first mistake, with its line and a mend; it says how many others there are.
    """
    try:
        return model.model_validate(_frozen(document.data), strict=True)
    except ValidationError as error:
        raise translate(model, document.data, document.source, error) from None


def _frozen(data: object) -> object:
    """The data with tuples for lists: strict models take nothing else."""
    if isinstance(data, dict):
        return {key: _frozen(value) for key, value in data.items()}
    return tuple(map(_frozen, data)) if isinstance(data, list) else data


def _text(path: Path) -> str:
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            raise UserError("this is a folder", "name a file in it", file=path)
        if not stat.S_ISREG(mode):  # a pipe or a device would make us wait for ever
            raise UserError("this is no ordinary file", "name a YAML file", file=path)
        with path.open("rb") as stream:
            raw = stream.read(LARGEST_FILE + 1)
    except FileNotFoundError:
        raise UserError("there is no such file", _nearest_file(path), file=path) from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise UserError(f"cannot read the file ({reason})", "check its name and rights", file=path) from None
    if len(raw) > LARGEST_FILE:
        what = f"the file is larger than {LARGEST_FILE >> 10} KiB"
        raise UserError(what, "is it a scenario or robot at all?", file=path)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise UserError("the file is no UTF-8 text", "save it as UTF-8", file=path, line=line) from None


def _nearest_file(path: Path) -> str:
    try:
        names = sorted(entry.name for entry in path.parent.iterdir() if entry.is_file())
    except OSError:
        return f"there is no folder '{path.parent}' either"
    mend = did_you_mean(path.name, names)
    if mend.startswith("did you mean"):
        return mend
    yamls = [name for name in names if name.endswith((".yaml", ".yml"))]
    return f"the folder has {', '.join(yamls[:12])}" if yamls else "the folder has no YAML files"


class _PlainLoader(yaml.SafeLoader):
    """PyYAML's composer without anchors, aliases and tags, and with a limit on nesting."""

    _depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        event = self.peek_event()  # type: ignore[no-untyped-call]
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
            raise yaml.MarkedYAMLError(
                problem="anchors and aliases (& and *) are not read",
                note="write the value out, or put text that starts with & or * in quotes",
                problem_mark=event.start_mark,
            )
        if getattr(event, "tag", None) is not None:
            raise yaml.MarkedYAMLError(
                problem=f"tags are not read: '{event.tag}'",
                note="leave it out, or put text that starts with ! in quotes",
                problem_mark=event.start_mark,
            )
        if self._depth >= DEEPEST_NESTING:
            raise yaml.MarkedYAMLError(
                problem=f"brackets or lists nested more than {DEEPEST_NESTING} deep",
                note="flatten them",
                problem_mark=event.start_mark,
            )
        self._depth += 1
        try:
            return super().compose_node(parent, index)
        finally:
            self._depth -= 1


def _compose(text: str, file: Path | str | None) -> yaml.Node | None:
    loader = None
    try:
        loader = _PlainLoader(text)
        return loader.get_single_node()
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        what = f"a character that does not belong in text (code {int(error.character):#04x})"
        raise UserError(what, "remove it; is this a text file?", file=file, line=line) from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        if "end of stream" in (error.problem or "") or "<stream end>" in (error.problem or ""):
            mark = error.context_mark or mark  # where the bracket or quote was opened
        line_or_none = None if mark is None else mark.line + 1
        what, mend = _yaml_problem(error)
        raise UserError(what, mend, file=file, line=line_or_none) from None
    except (ValueError, OverflowError):  # PyYAML's own arithmetic on escapes and on numbers in directives
        line_or_none = None if loader is None else loader.line + 1
        mend = "check escapes such as \\U and lines that start with %"
        raise UserError("malformed YAML: an impossible number", mend, file=file, line=line_or_none) from None


def _yaml_problem(error: yaml.MarkedYAMLError) -> tuple[str, str]:
    problem = error.problem or "malformed YAML"
    if error.note is not None:  # our own
        return problem, error.note
    what = f"malformed YAML: {one_line(problem)}"
    if "\\t" in problem:
        return what, "indent with spaces, not tabs"
    if "mapping values are not allowed" in problem:
        return what, "put text that has ': ' in quotes, and check the indentation"
    if "found another document" in problem or "document" in (error.context or ""):
        return what, "keep one document: remove the '---' or '...' line"
    if "could not find expected ':'" in problem:
        return what, "each line is 'key: value', with a space after the colon"
    if "end of stream" in problem or "expected ',' or" in problem:
        return what, "close the bracket or quote, and put commas between the items"
    return what, "check the indentation, colons, brackets and quotes on this line and the one above"


def _plain(node: yaml.Node, place: Place, lines: dict[Place, int], file: Path | str | None) -> object:
    lines.setdefault(place, node.start_mark.line + 1)
    if isinstance(node, yaml.ScalarNode):
        return _scalar(node, file)
    if isinstance(node, yaml.SequenceNode):
        return [_plain(item, (*place, index), lines, file) for index, item in enumerate(node.value)]
    data: dict[str, object] = {}
    for key_node, value_node in node.value:
        if not isinstance(key_node, yaml.ScalarNode):
            raise _at(key_node, file, "a key must be a plain word", "write 'key: value'")
        key = _text_of(key_node, file)
        here = (*place, key)
        if key in data:
            what = f"key '{key}' stands twice, first in line {lines[here]}"
            raise _at(key_node, file, what, "keep one of the two")
        lines[here] = key_node.start_mark.line + 1  # the key's line, not that of a value below it
        data[key] = _plain(value_node, here, lines, file)
    return data


def _scalar(node: yaml.ScalarNode, file: Path | str | None) -> object:
    text = _text_of(node, file)
    if node.style is not None:  # quoted, or a block of text
        return text
    try:
        return plain_scalar(text)
    except ValueError as error:
        what, _, mend = str(error).partition("; ")
        raise _at(node, file, what, mend) from None


def _text_of(node: yaml.ScalarNode, file: Path | str | None) -> str:
    text = str(node.value)
    if any("\ud800" <= character <= "\udfff" for character in text):  # only an escape can smuggle one in
        raise _at(
            node, file, "half a character (a lone surrogate such as \\ud800)", "write the character itself"
        )
    return text


def plain_scalar(text: str) -> str | int | float | bool | None:
    """What unquoted text in a file means.

    Raises:
        ValueError: If it is a number that is infinite, not a number, or too large; "what; mend".
    """
    if text.lower() in _WORDS:
        return _WORDS[text.lower()]
    if _INTEGER.match(text):
        if len(text) > 20 or abs(int(text)) > LARGEST_INTEGER:
            raise ValueError(
                f"the number {text[:20]}{'...' * (len(text) > 20)} is too large; stay below 1e15"
            )
        return int(text)
    if _FLOAT.match(text):
        value = float(text)
        if math.isfinite(value):
            return value
    if _FLOAT.match(text) or _NOT_FINITE.match(text):
        raise ValueError(f"'{text[:20]}' is not a finite number; write a number such as 0.5")
    return text


def _at(node: yaml.Node, file: Path | str | None, what: str, mend: str) -> UserError:
    return UserError(what, mend, file=file, line=node.start_mark.line + 1)
