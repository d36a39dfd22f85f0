"""The bench file: which board is whose, which camera is left, where the calibrations are.

::

    boards:
      student:   {unique_id: 3f0a11c25b7e9d04}
      teacher_0: {unique_id: 77b1d0e8a4c2f196}
      rig:       {unique_id: 0c9e55aa21b8d37f}
    cameras:
      left: /dev/v4l/by-id/usb-ACME_Camera_0123-video-index0
      right: /dev/v4l/by-id/usb-ACME_Camera_0456-video-index0
    calibrations: calibrations

Boards are named by what does not change when a cable is plugged in elsewhere. What is where is looked up when the
bench is opened; this file only says what there should be.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal, Self

from pydantic import Field, PrivateAttr, field_validator, model_validator

from testbed.document_errors import mistake
from testbed.document_writing import document_text
from testbed.documents import Source, read_document, validate
from testbed.errors import UserError
from testbed.experiment.atomic import write_text
from testbed.scenario.base import Identifier, Spec, unit_field
from testbed.world.placement import STUDENT

RIG = "rig"
"""The board that pans the cameras."""
PAN = "pan"
"""The only joint of the rig's board."""


class BoardSpec(Spec):
    """One physical thing with servos: a robot, or the rig's pan."""

    unique_id: str | None = Field(
        None,
        min_length=1,
        max_length=64,
        pattern=r"^[0-9A-Za-z_.:-]+$",
        description="what the firmware calls its board, or the USB serial number of its adapter",
    )
    port: str | None = Field(
        None,
        min_length=1,
        max_length=4096,
        description="only where there is no unique id: ports change places",
    )
    build: Literal["servo_board", "feetech"] = Field(
        "servo_board", description="hobby servos on a board of our firmware, or bus servos"
    )
    robot: str = Field(
        "crawler",
        min_length=1,
        description="the body that it moves, a shipped robot or a file: names its joints",
    )
    imu: str | None = Field(
        None, description="bus servos: the unique id or port of the board that carries the tilt sensor"
    )

    @model_validator(mode="after")
    def _can_be_found(self) -> Self:
        if self.unique_id is None and self.port is None:
            raise mistake("a board has neither unique_id nor port", "`testbed hardware find` lists both")
        if self.imu is not None and self.build != "feetech":
            raise mistake("a servo board carries its own tilt sensor", "remove 'imu'", at="imu")
        return self


class CamerasSpec(Spec):
    """The stereo pair, as seen from behind the cameras."""

    left: str = Field(
        min_length=1, max_length=4096, description="a stable device name, an address, or a file"
    )
    right: str = Field(min_length=1, max_length=4096)
    measured_baseline: float | None = unit_field(
        None, "m", gt=0, le=1, description="between the lenses, by tape measure; the scenario's if not said"
    )

    @model_validator(mode="after")
    def _are_two(self) -> Self:
        if self.left == self.right:
            raise mistake("both eyes are the same camera", "`testbed hardware find` lists them", at="right")
        return self


class BenchSpec(Spec):
    """A physical bench."""

    name: Identifier = "bench"
    boards: dict[Identifier, BoardSpec] = Field(
        description="by agent: student, teacher_0, teacher_1, ... and rig"
    )
    cameras: CamerasSpec | None = Field(None, description="without them only boards can be looked at")
    calibrations: str = Field(
        "calibrations", min_length=1, description="the folder of calibrations, beside this file"
    )
    board_square: float | None = unit_field(
        None,
        "m",
        gt=0.005,
        le=0.2,
        description="a square of the printed board, measured; as designed if not said",
    )
    port_globs: tuple[str, ...] = Field(
        (), max_length=20, description="further places to look for ports, such as ports/tty-*"
    )
    clock: str | None = Field(
        None, description="of an emulated bench: the file that tells its time, which may go slower than ours"
    )
    hands: str | None = Field(
        None, description="of an emulated bench: the socket where its hands take requests; people otherwise"
    )

    _source: Source = PrivateAttr(default_factory=Source)

    @field_validator("boards")
    @classmethod
    def _are_agents(cls, boards: dict[str, BoardSpec]) -> dict[str, BoardSpec]:
        for agent in boards:
            if not is_agent(agent):
                what = f"there is no agent '{agent}'"
                raise mistake(what, "boards belong to student, teacher_0, teacher_1, ... and rig", at=agent)
        return boards

    @model_validator(mode="after")
    def _are_different(self) -> Self:
        for key in ("unique_id", "port"):
            taken: dict[str, str] = {}
            for agent, board in self.boards.items():
                value = getattr(board, key)
                if value is not None and (other := taken.setdefault(value, agent)) != agent:
                    what = f"{other} and {agent} are the same board"
                    raise mistake(what, "give each its own", at=f"boards.{agent}.{key}")
        return self

    @property
    def file(self) -> Path | None:
        """The file that this was read from."""
        return None if self._source.file is None else Path(self._source.file)

    @property
    def calibration_folder(self) -> Path:
        """The folder of calibrations; a relative one is beside the bench file."""
        beside = self.file.parent if self.file is not None else Path()
        return beside / Path(self.calibrations).expanduser()

    @property
    def robots(self) -> tuple[str, ...]:
        """The agents that have a board, without the rig, the student first."""
        return tuple(sorted((agent for agent in self.boards if agent != RIG), key=_order))

    def board(self, agent: str) -> BoardSpec:
        """An agent's board.

        Raises:
            UserError: If the bench has none.
        """
        if agent not in self.boards:
            what, mend = (
                f"the bench has no board for {agent}",
                "plug it in and add it; `testbed hardware find`",
            )
            raise self._source.error(("boards",), what, mend)
        return self.boards[agent]


def is_agent(name: str) -> bool:
    """Whether a name is that of somebody on a bench: student, teacher_0, teacher_1, ... or rig."""
    number = name.removeprefix("teacher_")
    return name in (STUDENT, RIG) or (number != name and number.isascii() and number.isdigit())


def _order(agent: str) -> tuple[int, int]:
    return (0, 0) if agent == STUDENT else (1, int(agent.rpartition("_")[2]))


def load_bench(path: Path | str) -> BenchSpec:
    """Read a bench file.

    Raises:
        UserError: For any mistake in it, with its line and how to mend it.
    """
    if not Path(path).exists():
        what = "there is no such bench file"
        mend = "`testbed hardware find --out bench.yaml` begins one, `testbed hardware emulate` gives you one to try"
        raise UserError(what, mend, file=path)
    document = read_document(path)
    spec = validate(BenchSpec, document)
    spec._source = document.source
    return spec


def save_bench(spec: BenchSpec, path: Path) -> BenchSpec:
    """Write a bench file, whole or not at all; returns it as read back.

    Raises:
        UserError: If the place cannot be written.
    """
    data = spec.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    write_text(path, document_text({"name": spec.name, **data}, width=1000))
    return load_bench(path)
