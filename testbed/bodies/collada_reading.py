"""COLLADA meshes (.dae) from strangers.

The file's unit of length is followed. Its ``up_axis`` is not, as PyBullet and ROS do not follow it: robots' meshes are
drawn in their links' frames, whatever the drawing program wrote there.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import trimesh

from testbed.bodies.parts import Vector
from testbed.bodies.xml_reading import Element, parsed_xml
from testbed.errors import UserError

_MOST_COPIED = 1 << 28
"""Bytes of a file times the copies that it places: a few lines can ask for billions of pieces."""


@np.errstate(invalid="ignore")
def read_collada(raw: bytes, path: Path) -> trimesh.Trimesh:
    """The surface of a COLLADA document, all of its scene's pieces in one.

    Args:
        raw: The document.
        path: Names it in errors.

    Raises:
        UserError: If it is no well-formed XML, has a document type, lacks pieces that it names, or places too many
            copies of them.
        Exception: Whatever else pycollada stumbles over.
    """
    from collada import Collada, DaeError  # only where there are such meshes
    from collada.triangleset import BoundTriangleSet

    expected = _pieces(parsed_xml(raw, path), len(raw), path)
    document = Collada(io.BytesIO(raw), ignore=[DaeError])  # cameras, lights and textures may be broken
    corners: list[Vector] = []
    found = 0
    for placed in document.scene.objects("geometry") if document.scene else ():
        found += 1
        for surface in placed.primitives():
            if hasattr(surface, "triangleset"):  # of polygons
                surface = surface.triangleset()
            if isinstance(surface, BoundTriangleSet) and len(surface):
                corners.append(surface.vertex[surface.vertex_index].reshape(-1, 3))
    if found != expected:
        raise UserError("some of the mesh's pieces cannot be read", "export it anew", file=path)
    every = np.concatenate([np.zeros((0, 3)), *corners])
    if not np.isfinite(every).all():
        raise UserError("the mesh has corners that are no numbers", "export it anew", file=path)
    unit = document.assetInfo.unitmeter
    faces = np.arange(len(every)).reshape(-1, 3)
    return trimesh.Trimesh(every * (1.0 if unit is None else unit), faces)


def _pieces(root: Element, size: int, path: Path) -> int:
    """How many pieces the scene places: a node's own, and those of nodes that it repeats.

    Raises:
        UserError: If nodes repeat each other in a ring, or too often.
    """
    nodes: dict[str, Element] = {}
    different = 0

    def gather(element: Element) -> None:
        nonlocal different
        different += _local(element) == "geometry"
        if "id" in element.attributes:
            nodes[element.attributes["id"]] = element
        for child in element.children:
            gather(child)

    gather(root)
    counted: dict[int, int] = {}

    def count(element: Element, above: tuple[int, ...] = ()) -> int:
        if id(element) in above:
            raise UserError("the mesh's nodes form a ring", "export it anew", file=path, line=element.line)
        if id(element) not in counted:
            counted[id(element)] = _local(element) == "instance_geometry"
            inner = (*above, id(element))
            counted[id(element)] += sum(count(child, inner) for child in _below(element, nodes))
        return counted[id(element)]

    shown = [
        nodes[child.attributes["url"][1:]]
        for scene in root.children
        if _local(scene) == "scene"
        for child in scene.children
        if _local(child) == "instance_visual_scene" and child.attributes.get("url", "")[1:] in nodes
    ]
    total = sum(count(scene) for scene in shown)
    if (total - different) * size > _MOST_COPIED:
        raise UserError("the mesh repeats its pieces too often", "export it anew", file=path)
    return total


def _below(element: Element, nodes: dict[str, Element]) -> list[Element]:
    if _local(element) != "instance_node":
        return element.children
    repeated = nodes.get(element.attributes.get("url", "")[1:])
    return [] if repeated is None else [repeated]


def _local(element: Element) -> str:
    """The tag without the prefix of its namespace."""
    return element.tag.rpartition(":")[2]
