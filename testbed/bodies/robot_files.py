"""Files that a scenario refers to: what they say, for its hash, and copies that mean the same wherever they are.

A robot's YAML and a recording are one file each; a URDF brings its meshes along.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from testbed.documents import read_document
from testbed.errors import UserError
from testbed.recording import RECORDING_SUFFIXES, read_recording


def content_of(path: Path) -> object:
    """What a file says, as plain data: another place, comments or order of keys change nothing.

    Raises:
        UserError: If it, or a mesh that it refers to, cannot be read.
    """
    suffix = path.suffix.lower()
    if suffix in RECORDING_SUFFIXES:
        read_recording(path)
        return {"recording": _digest(path.read_bytes())}
    if suffix == ".urdf":
        text, meshes = _with_meshes(path)
        digests = {name: _digest(contents) for name, contents in meshes.items()}
        for name, digest in digests.items():
            text = text.replace(name.encode(), digest.encode())
        return {"urdf": _digest(text)}
    return read_document(path).data


def copies_of(path: Path) -> dict[str, bytes]:
    """The file and what it refers to by names for one folder, the file itself first.

    Raises:
        UserError: If it, or a mesh that it refers to, cannot be read.
    """
    if path.suffix.lower() != ".urdf":
        return {path.name: path.read_bytes()}
    text, meshes = _with_meshes(path)
    return {path.name: text, **meshes}


def _with_meshes(path: Path) -> tuple[bytes, dict[str, bytes]]:
    """A URDF's text with its meshes named ``<stem>-<hash8>.<suffix>``, and these."""
    from testbed.bodies.urdf_reading import mesh_file, named_meshes  # needs more than others do
    from testbed.bodies.xml_reading import parsed_xml, read_xml

    names = named_meshes(read_xml(path))
    text = path.read_bytes()
    meshes = {}
    for spelled in names:
        contents = mesh_file(spelled, path).read_bytes()
        plain = f"{path.stem}-{_digest(contents)[:8]}{Path(spelled).suffix.lower()}"
        meshes[plain] = contents
        for quote in (b'"', b"'"):
            text = text.replace(quote + _escaped(spelled) + quote, quote + plain.encode() + quote)
    if set(named_meshes(parsed_xml(text, path))) != set(meshes):
        raise UserError("a mesh's file name is spelled oddly", "use plain letters in it", file=path)
    return text, meshes


def _escaped(name: str) -> bytes:
    for character, entity in (("&", "&amp;"), ("<", "&lt;"), (">", "&gt;")):
        name = name.replace(character, entity)
    return name.encode()


def _digest(contents: bytes) -> str:
    return hashlib.sha256(contents).hexdigest()
