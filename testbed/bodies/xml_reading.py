"""XML from strangers, read with care: elements, attributes and lines, and nothing else.

There are no document types, so that no entity can blow up or fetch a file; text between tags is left out. Blank lines
before the document and zeros behind it, which other readers overlook, do no harm.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from testbed.errors import UserError

LARGEST_XML = 1 << 23  # bytes
_DEEPEST = 60
_MOST_ELEMENTS = 300_000


@dataclass
class Element:
    """A tag with its attributes, its children and its line."""

    tag: str
    attributes: Mapping[str, str]
    line: int
    children: list[Element] = field(default_factory=list)

    def all(self, tag: str) -> Iterator[Element]:
        """The children with this tag."""
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> Element | None:
        """The first child with this tag, if there is one."""
        return next(self.all(tag), None)


def read_xml(path: Path) -> Element:
    """The root of an XML file.

    Raises:
        UserError: If it cannot be read, is no well-formed XML, or has a document type; with the line.
    """
    try:
        with path.open("rb") as stream:
            raw = stream.read(LARGEST_XML + 1)
    except OSError as error:
        what = "there is no such file" if isinstance(error, FileNotFoundError) else "the file cannot be read"
        raise UserError(what, "look at its name and its folder", file=path) from None
    if len(raw) > LARGEST_XML:
        raise UserError("the file has more than 8 MB", "is it really a description of a robot?", file=path)
    return parsed_xml(raw, path)


def parsed_xml(raw: bytes, path: Path) -> Element:
    """The root of XML text; ``path`` names it in errors.

    Raises:
        UserError: As :func:`read_xml` does.
    """
    document = raw.lstrip()
    blank = raw[: len(raw) - len(document)].count(b"\n")
    if document.startswith(b"<"):  # of one byte a character
        document = document.rstrip(b"\0 \t\r\n")
    parser = expat.ParserCreate()
    count = 0
    open_elements: list[Element] = [Element("", {}, 0)]

    def begin(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        line = parser.CurrentLineNumber + blank
        if len(open_elements) > _DEEPEST:
            raise UserError("the elements are nested too deeply", "", file=path, line=line)
        if count > _MOST_ELEMENTS:
            raise UserError(f"there are more than {_MOST_ELEMENTS} elements", "", file=path, line=line)
        element = Element(tag, attributes, line)
        open_elements[-1].children.append(element)
        open_elements.append(element)

    def refuse(*_: object) -> None:
        line = parser.CurrentLineNumber + blank
        raise UserError("document types are not read, for safety", "remove the DOCTYPE", file=path, line=line)

    parser.StartElementHandler = begin
    parser.EndElementHandler = lambda tag: open_elements.pop()
    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    try:
        parser.Parse(document, True)
    except expat.ExpatError as error:
        what = f"this is no well-formed XML ({expat.ErrorString(error.code)})"
        raise UserError(what, "mend it there or just before", file=path, line=error.lineno + blank) from None
    return open_elements[0].children[0]
