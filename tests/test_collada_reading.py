"""COLLADA meshes: as large as others have them; what is broken or hostile is refused in a line."""

from __future__ import annotations

import contextlib
import tempfile
from pathlib import Path

import numpy as np
import pybullet_data
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from testbed.bodies.meshes import load_mesh
from testbed.errors import UserError
from testbed.physics import Simulation

DATA = Path(pybullet_data.getDataPath())
pytestmark = pytest.mark.filterwarnings("ignore:the matrix subclass:PendingDeprecationWarning")


@pytest.mark.parametrize(
    "name", ["duck.dae", "racecar/meshes/cone.dae", "racecar/meshes/left_front_wheel.dae"]
)
def test_collada_is_as_large_as_bullet_has_it(name: str, tmp_path: Path) -> None:
    """Their units are a centimetre, an inch and a metre, and two of them say that y is up."""
    import pybullet

    text = (
        f'<robot name="it"><link name="it"><collision><geometry><mesh filename="{DATA / name}"/></geometry>'
    )
    (tmp_path / f"{Path(name).stem}.urdf").write_text(f"{text}</collision></link></robot>")
    with Simulation() as simulation:
        number = pybullet.loadURDF(
            str(tmp_path / f"{Path(name).stem}.urdf"), physicsClientId=simulation.client
        )
        box = pybullet.getAABB(number, physicsClientId=simulation.client)
    np.testing.assert_allclose(load_mesh(DATA / name).bounds, box, atol=0.003)  # Bullet adds its margin


def collada(folder: Path) -> Path:
    file = folder / "arm.dae"
    arm = trimesh.creation.box((0.2, 0.02, 0.02))
    file.write_bytes(arm.export(file_type="dae"))
    return file


def test_collada_repeats_its_nodes_where_it_says(tmp_path: Path) -> None:
    file = collada(tmp_path)
    text = file.read_text()
    node = text[text.index("<node ") : text.index("</node>") + len("</node>")]
    twice = '<node><translate>1 0 0</translate><instance_node url="#node0"/></node>'
    file.write_text(text.replace(node, node + twice))
    mesh = load_mesh(file)
    assert len(mesh.faces) == 24
    np.testing.assert_allclose(mesh.bounds, [[-0.1, -0.01, -0.01], [1.1, 0.01, 0.01]], atol=1e-6)


RING = '<node id="a"><instance_node url="#b"/></node><node id="b"><instance_node url="#a"/></node>'
BOMB = "".join(
    f'<node id="n{level}">{f"""<instance_node url="#n{level + 1}"/>""" * 10}</node>' for level in range(12)
)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "<COLLADA ",
            '<!DOCTYPE a [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><COLLADA ',
            "arm.dae:1: document types",
        ),
        ("<COLLADA ", '<!DOCTYPE a SYSTEM "file:///etc/passwd"><COLLADA ', "arm.dae:1: document types"),
        ("</COLLADA>", "", "no well-formed XML"),
        ("<COLLADA ", "PK\3\4<COLLADA ", "no well-formed XML"),
        ("<asset>", "<asset>" + "<a>" * 100 + "</a>" * 100, "nested too deeply"),
        ("<triangles ", "<tripods ", "no well-formed XML"),
        ('"#verts-array-vertices"', '"#nothing"', "some of the mesh's pieces cannot be read"),
        ("<p>1 1 3", "<p>1 1 300", "some of the mesh's pieces cannot be read"),
        ("<p>1 1 3", "<p>1 1", "arm.dae: "),
        ("-0.1 -0.01", "inf -0.01", "corners that are no numbers"),
        ("<scene>", "<no_scene>", "no well-formed XML"),
        ('<instance_visual_scene url="#', '<instance_visual_scene url="#not', "arm.dae: "),
        ('<node id="node0"', RING + '<node><instance_node url="#a"/></node><node id="node0"', "form a ring"),
        ('<node id="node0"', BOMB + '<node id="n12"', "repeats its pieces too often"),
    ],
)
def test_collada_that_is_broken_or_hostile_is_told_in_a_line(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    file = collada(tmp_path)
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(UserError) as caught:
        load_mesh(file)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@given(st.data())
@settings(max_examples=40, deadline=None)
def test_torn_collada_is_refused_or_a_mesh(data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = collada(Path(folder))
        raw = bytearray(file.read_bytes())
        if data.draw(st.booleans()):
            raw = raw[: data.draw(st.integers(0, len(raw) - 12))]
        else:
            raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
        file.write_bytes(raw)
        with contextlib.suppress(UserError):
            assert np.isfinite(load_mesh(file).vertices).all()
