"""Recorded motions: a table of times and joint angles, as CSV or Parquet.

::

    time,joint_a_deg,joint_b_deg
    0.0,0,0
    0.5,-40,10
    1.0,0,0

``time`` rises, in seconds; the other columns are joints' names with ``_deg``, in degrees. It is played over and over
with straight lines between the rows: where it begins and ends in the same posture, it never jumps.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbed.bodies.morphology import Vector
from testbed.errors import UserError, did_you_mean

RECORDING_SUFFIXES = (".csv", ".parquet")
LARGEST_RECORDING = 1 << 24  # bytes
_TIME, _DEGREES = "time", "_deg"


@dataclass(frozen=True)
class Recording:
    """A motion that was recorded.

    Attributes:
        times: (n,) s, rising from 0.
        angles: (n,) rad of each joint by its name.
    """

    times: Vector
    angles: Mapping[str, Vector]

    def posture(self, time: float, joints: Sequence[str], rest: Vector) -> Vector:
        """(joints,) rad at a time in s; joints that were not recorded are at ``rest``."""
        now = time % self.times[-1]
        return np.array(
            [
                np.interp(now, self.times, self.angles[joint]) if joint in self.angles else flat
                for joint, flat in zip(joints, rest.tolist(), strict=True)
            ]
        )


def read_recording(path: Path | str) -> Recording:
    """A recording from its file.

    Raises:
        UserError: If it cannot be read or is no recording; with the line where there is one.
    """
    file = Path(path)
    if file.suffix.lower() not in RECORDING_SUFFIXES:
        raise UserError("a recording is a .csv or a .parquet file", "name one of these", file=file)
    try:
        with file.open("rb") as stream:
            raw = stream.read(LARGEST_RECORDING + 1)
    except OSError as error:
        raise UserError("the recording cannot be read", str(error.strerror), file=file) from None
    if len(raw) > LARGEST_RECORDING:
        raise UserError("the recording has more than 16 MB", "record at fewer frames a second", file=file)
    columns = _from_csv(raw, file) if file.suffix.lower() == ".csv" else _from_parquet(raw, file)
    return _recording(columns, file)


def _from_csv(raw: bytes, file: Path) -> dict[str, Vector]:
    try:
        rows = list(csv.reader(io.StringIO(raw.decode("utf-8-sig"), newline="")))
    except (UnicodeDecodeError, csv.Error):
        raise UserError("the recording is no CSV text", "save it as UTF-8, with commas", file=file) from None
    if not rows:
        raise UserError("the recording is empty", "begin with 'time,joint_a_deg'", file=file, line=1)
    names = [name.strip() for name in rows[0]]
    values = []
    for line, row in enumerate(rows[1:], start=2):
        if not row:
            continue
        try:
            values.append([float(cell) for cell in row])
        except ValueError:
            raise UserError(
                "a cell is no number", "write numbers such as 0.5", file=file, line=line
            ) from None
        if len(row) != len(names):
            what = f"the row has {len(row)} cells, the first line {len(names)}"
            raise UserError(what, "give each column a number", file=file, line=line)
    table = np.array(values, dtype=float).reshape(-1, len(names))
    if len(set(names)) < len(names):
        raise UserError("two columns have one name", "give each its own", file=file, line=1)
    return dict(zip(names, table.T, strict=True))


def _from_parquet(raw: bytes, file: Path) -> dict[str, Vector]:
    import pyarrow as arrow
    import pyarrow.parquet as parquet

    try:
        table = parquet.read_table(io.BytesIO(raw))
        return {name: np.asarray(table.column(name).to_numpy(), dtype=float) for name in table.column_names}
    except (arrow.ArrowException, ValueError, TypeError):
        raise UserError("the recording is no Parquet table of numbers", "write it anew", file=file) from None


def _recording(columns: dict[str, Vector], file: Path) -> Recording:
    times = columns.pop(_TIME, None)
    if times is None:
        raise UserError("the recording has no column 'time'", "add one, in seconds", file=file, line=1)
    for name in columns:
        if not name.endswith(_DEGREES) or name == _DEGREES:
            mend = did_you_mean(name, [f"{name}{_DEGREES}"])
            raise UserError(f"column '{name}' is no joint's angle in degrees", mend, file=file, line=1)
    if not columns or len(times) < 2:
        raise UserError(
            "the recording has too little in it", "give two rows and one joint or more", file=file
        )
    if not all(np.isfinite(column).all() for column in (times, *columns.values())):
        raise UserError("the recording has numbers that are not finite", "leave these rows out", file=file)
    late = np.flatnonzero(np.diff(times) <= 0)
    if late.size:
        what = f"time does not rise from {times[late[0]]:g} to {times[late[0] + 1]:g} s"
        raise UserError(what, "sort the rows by time", file=file)
    angles = {name.removesuffix(_DEGREES): np.radians(column) for name, column in columns.items()}
    return Recording(times - times[0], angles)
