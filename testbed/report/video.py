"""The teacher's demonstration beside the student's imitation, posed again from what was recorded.

H.264 in mp4, which every browser plays, by the ffmpeg that the package imageio-ffmpeg carries.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import cv2
import imageio_ffmpeg
import numpy as np
from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont

from testbed.bodies.morphology import Morphology, Vector
from testbed.errors import UserError
from testbed.experiment.atomic import write_whole
from testbed.report.film import Camera, Colour, Frame, floor, paint
from testbed.report.reading import Array, Row, Trial
from testbed.report.style import BLUE, INK, MUTED, ORANGE

PANE = (400, 300)
RATE = 30
_SHARPNESS = 2  # pictures are painted this many times larger, then averaged
_LONGEST = 20.0  # seconds
_ROUNDING = 1e-3  # of a step or frame: a control step written as 0.01667 is still half a frame
_BODY = {INK: "#5d6a78"}  # a body in the colour of ink would show no shading


@dataclass(frozen=True)
class Pane:
    """One side of the picture: an agent over a stretch of the trial.

    Attributes:
        agent: Whose recorded states to show.
        title: What it is.
        colour: Of the title and the body, ``#rrggbb``.
        first: Index of the first recorded state.
        count: How many states.
    """

    agent: str
    title: str
    colour: str
    first: int
    count: int


def panes(trial: Trial) -> tuple[Pane, ...]:
    """What the video of a trial shows: the imitated teacher and the student, or else the first two candidates."""
    chosen = next((row for row in trial.rows if row["chosen"]), None)
    start, steps = trial.array("perform/start_step"), trial.array("perform/steps")
    if chosen is not None and start is not None and steps is not None and int(steps) > 1:
        return (
            _demonstration(trial, chosen, "demonstrates", int(steps)),
            Pane("student", "the student imitates", INK, int(start) - 1, int(steps)),
        )
    found = [row for row in trial.rows if row["found"]]
    return tuple(
        _demonstration(trial, row, "is watched", round(_LONGEST / _control_step(trial))) for row in found[:2]
    )


def write_video(trial: Trial, bodies: Mapping[str, Morphology], path: Path) -> tuple[Path, Frame] | None:
    """Write the video of a trial.

    Args:
        trial: The trial.
        bodies: The agents' bodies by name.
        path: The mp4 to write.

    Returns:
        The path and a still from the middle; None where there is nothing to show.
    """
    shown = panes(trial)
    films = []
    stride = stride_of(trial)
    for pane in shown:
        base, joints = trial.array(f"truth/{pane.agent}/base"), trial.array(f"truth/{pane.agent}/joints")
        if base is None or joints is None:
            return None
        films.append(_film(pane, bodies[pane.agent], base.astype(float), joints.astype(float), stride))
    if not films:
        return None
    size = (PANE[0] * len(films), PANE[1])
    frames = (np.hstack([next(film) for film in films]) for _ in range(frame_count(shown, stride)))
    encoded, still = _encoded(frames, size, still_at=frame_count(shown, stride) // 2)
    write_whole(path, lambda file: _write_all(file, encoded))
    return path, still


def _encoded(frames: Iterator[Frame], size: tuple[int, int], *, still_at: int) -> tuple[bytes, Frame]:
    """The frames as an mp4, and one of them."""
    still = np.full((size[1], size[0], 3), 255, np.uint8)
    with tempfile.TemporaryDirectory(prefix="testbed-") as folder:
        path = Path(folder) / "video.mp4"
        writer = imageio_ffmpeg.write_frames(
            str(path), size, fps=RATE, codec="libx264", quality=None, macro_block_size=2,
            output_params=["-crf", "21", "-preset", "medium", "-threads", "1", "-movflags", "+faststart",
                           "-fflags", "+bitexact", "-flags:v", "+bitexact", "-map_metadata", "-1"],
        )  # fmt: skip
        writer.send(None)
        for index, frame in enumerate(frames):
            writer.send(np.ascontiguousarray(frame))
            still = frame if index == still_at else still
        writer.close()
        return path.read_bytes(), still


def _write_all(file: IO[bytes], contents: bytes) -> None:
    file.write(contents)


def stride_of(trial: Trial) -> float:
    """How many control steps pass from one frame to the next; below 1 where steps are longer than frames."""
    return 1 / (RATE * _control_step(trial))


def frame_count(shown: tuple[Pane, ...], stride: float) -> int:
    """How many frames the video has: as many as the longest pane needs; the shorter stands still at its end."""
    longest = max(_frames(pane.count, stride) for pane in shown)
    return min(longest, round(_LONGEST * RATE))


def _frames(states: int, stride: float) -> int:
    return math.ceil(states / stride - _ROUNDING)


def _control_step(trial: Trial) -> float:
    """Seconds from one recorded state to the next."""
    step = trial.array("time/control_step")
    if step is None:
        raise UserError(
            f"trial {trial.number} does not tell its control step", "run the scenario again", file=trial.path
        )
    return float(step)


def _demonstration(trial: Trial, row: Row, does: str, steps: int) -> Pane:
    """A teacher from the student's first look to its last, or for ``steps`` if that is less."""
    looks, base = trial.array(f"{row['teacher']}/look_steps"), trial.array(f"truth/{row['teacher']}/base")
    first, count = 0, 2
    if looks is not None and base is not None:
        first = max(0, int(looks[0]) - 1)
        count = max(2, min(int(looks[-1]) - first, steps, len(base) - first))
    colour = BLUE if row["truth"] == "appropriate" else ORANGE
    return Pane(row["teacher"], f"{row['teacher']} ({row['robot']}) {does}", colour, first, count)


def _film(pane: Pane, body: Morphology, base: Array, joints: Array, stride: float) -> Iterator[Frame]:
    """Frames without end: after its last moment the agent stands still."""
    base, joints = (states[pane.first : pane.first + pane.count] for states in (base, joints))
    camera = Camera.watching(body, base, (PANE[0] * _SHARPNESS, PANE[1] * _SHARPNESS))
    empty = floor(camera)
    colour = _rgb(_BODY.get(pane.colour, pane.colour))
    frame = empty
    for number in range(_frames(len(base), stride)):
        index = min(int(number * stride + _ROUNDING), len(base) - 1)
        image = empty.copy()
        paint(image, camera, body, _poses(body, base[index], joints[index]), colour)
        frame = _captioned(np.asarray(cv2.resize(image, PANE, interpolation=cv2.INTER_AREA), np.uint8), pane)
        yield frame
    while True:
        yield frame


def _poses(body: Morphology, base: Vector, joints: Vector) -> dict[str, Vector]:
    x, y, z, w = base[3:] / np.linalg.norm(base[3:])
    root = np.eye(4)
    root[:3, 3] = base[:3]
    root[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return {name: root @ pose for name, pose in body.poses(joints).items()}


def _captioned(frame: Frame, pane: Pane) -> Frame:
    image = Image.fromarray(frame)
    draw = ImageDraw.Draw(image)
    draw.text((14, 11), pane.title, font=_font(14, bold=True), fill=pane.colour)
    draw.text((14, PANE[1] - 24), "floor lines: 10 cm", font=_font(10), fill=MUTED)
    return np.asarray(image)


def _rgb(colour: str) -> Colour:
    red, green, blue = (int(colour[start : start + 2], 16) for start in (1, 3, 5))
    return red, green, blue


def _font(size: int, *, bold: bool = False) -> ImageFont.FreeTypeFont:
    weight = "bold" if bold else "normal"
    properties = font_manager.FontProperties(family="DejaVu Sans", weight=weight)
    return ImageFont.truetype(font_manager.findfont(properties), size)
