"""Seeing: from a scene to luminosities.

A `StereoRig` says where each pixel looks; a model is a few primitives (`testbed.vision.primitives`); the
kernel says which of the requested pixels those primitives darken. Asking for few pixels is cheap on purpose:
Section 3.3.3 of the paper models a teacher from a small part of its images.

    rig = StereoRig()
    parts = np.array([[CUBOID, 0.0, 0.1, 0.9, 0.0, 0.14, 0.11, 0.05]])
    left, right = render(parts, rig)                        # two (75, 100) images
    luminosity(parts, rig, np.array([[50, 37], [0, 0]]))    # (2, 2): two pixels in both eyes
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from testbed.vision.camera import StereoRig
from testbed.vision.primitives import CAPPED_CYLINDER, COLUMNS, CUBOID, SHAPES, SPHERE, to_trimesh

if TYPE_CHECKING:
    from testbed.vision.kernel import PART_LUMINOSITY, WHITE, luminosity, render

__all__ = [
    "CAPPED_CYLINDER",
    "COLUMNS",
    "CUBOID",
    "PART_LUMINOSITY",
    "SHAPES",
    "SPHERE",
    "WHITE",
    "StereoRig",
    "luminosity",
    "render",
    "to_trimesh",
]


def __getattr__(name: str) -> Any:
    # numba takes half a second to import: only those who render pay for it.
    if name in __all__:  # and not yet found: it is the kernel's
        from testbed.vision import kernel

        return getattr(kernel, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
