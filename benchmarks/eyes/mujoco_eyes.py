"""MuJoCo's two ways to see: its ray caster, and its renderer through EGL. Geoms are changed in place."""

from __future__ import annotations

import contextlib
import io
import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.eyes import Look, MissingError, Model, Rays, shades
from testbed.vision import CAPPED_CYLINDER, CUBOID, StereoRig


def import_mujoco() -> Any:
    """The library, with its renderer on EGL.

    Raises:
        MissingError: If it is not installed.
    """
    os.environ.setdefault("MUJOCO_GL", "egl")  # read once, at the first import
    try:
        import mujoco
    except ImportError:
        raise MissingError("mujoco is not installed (pip install -e '.[bench]')") from None
    return mujoco


class Scene:
    """A world of k bodies of a geom each, put where a model's parts are."""

    def __init__(self, parts: int, rig: StereoRig, eye: float) -> None:
        self.mujoco = import_mujoco()
        bodies = "<body mocap='true'><geom size='.1 .1 .1'/></body>" * parts
        vertical = np.degrees(2.0 * np.arctan(rig.height / 2.0 / rig.focal))
        self.model = self.mujoco.MjModel.from_xml_string(
            f"""<mujoco><statistic extent='1' center='0 0 1'/>
            <visual><quality offsamples='0'/><global offwidth='{rig.width}' offheight='{rig.height}'/></visual>
            <worldbody>{bodies}
            <camera name='eye' pos='{eye} 0 0' xyaxes='1 0 0 0 -1 0' fovy='{vertical}'/></worldbody></mujoco>"""
        )
        self.data = self.mujoco.MjData(self.model)
        self.mujoco.mj_forward(self.model, self.data)

    def put(self, model: Model) -> None:
        """Poses, sizes and shapes; also the radii and boxes by which MuJoCo culls, for it does not renew them."""
        kinds, world = self.mujoco.mjtGeom, self.model
        for i, (shape, x, y, z, omega, d1, d2, d3) in enumerate(model.tolist()):
            c, s = np.cos(omega / 2), np.sin(omega / 2)
            if shape == CUBOID:
                kind, size, box = kinds.mjGEOM_BOX, (d1 / 2, d3 / 2, d2 / 2), (d1 / 2, d3 / 2, d2 / 2)
                turn, reach = (c, 0.0, 0.0, s), np.sqrt(d1 * d1 + d2 * d2 + d3 * d3) / 2
            elif shape == CAPPED_CYLINDER:  # MuJoCo's capsule lies along z
                kind, size, box = kinds.mjGEOM_CAPSULE, (d1, d2 / 2, 0.0), (d1, d1, d1 + d2 / 2)
                turn, reach = (c * _R, -s * _R, c * _R, s * _R), d1 + d2 / 2
            else:
                kind, size, box = kinds.mjGEOM_SPHERE, (d1, 0.0, 0.0), (d1, d1, d1)
                turn, reach = (c, 0.0, 0.0, s), d1
            world.geom_type[i], world.geom_size[i] = kind, size
            world.geom_rbound[i], world.geom_aabb[i] = reach, (0.0, 0.0, 0.0, *box)
            world.bvh_aabb[world.body_bvhadr[i + 1]] = (0.0, 0.0, 0.0, *box)
            self.data.mocap_pos[i], self.data.mocap_quat[i] = (x, y, z), turn
        self.mujoco.mj_kinematics(self.model, self.data)


_R = float(np.sqrt(0.5))


def open_rays(rays: Rays, eye: float, parts: int, rig: StereoRig) -> Look:
    """``mj_multiRay``: one call for all rays."""
    scene = Scene(parts, rig, eye)
    ways = np.ascontiguousarray(np.column_stack([rays, np.ones(len(rays))])).ravel()
    met, far = np.empty(len(rays), np.int32), np.empty(len(rays))
    start = np.array([eye, 0.0, 0.0])

    def look(model: Model) -> NDArray[np.uint8]:
        scene.put(model)
        scene.mujoco.mj_multiRay(
            scene.model, scene.data, start, ways, None, True, -1, met, far, None, len(rays), 10.0
        )
        return shades(met >= 0)

    return look


def open_renderer(eye: float, parts: int, pixels: NDArray[np.int64], rig: StereoRig) -> Look:
    """The segmentation image by EGL, of which the pixels are read.

    Raises:
        MissingError: If there is no EGL.
    """
    scene = Scene(parts, rig, eye)
    try:
        with contextlib.redirect_stderr(io.StringIO()):
            renderer = scene.mujoco.Renderer(scene.model, rig.height, rig.width)
    except Exception as error:  # whatever the driver raises
        raise MissingError(f"no EGL here ({type(error).__name__})") from None
    renderer.enable_segmentation_rendering()

    def look(model: Model) -> NDArray[np.uint8]:
        scene.put(model)
        renderer.update_scene(scene.data, "eye")
        return shades(renderer.render()[..., 0].ravel()[pixels] >= 0)

    return look
