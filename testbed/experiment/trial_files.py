"""One trial on the disk: rows in Parquet, arrays in npz, each able to tell whether the other is whole.

Tables are plain Parquet that DuckDB, pandas and polars read as they are. Their metadata carries a checksum of
the arrays' file and one of the rows, so that truncation and flipped bytes are noticed in either file.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from testbed.experiment.record import TrialResult

_ARRAYS = b"testbed.arrays_sha256"
_ROWS = b"testbed.rows_sha256"
_TEXT = (
    "kind",
    "cell",
    "student",
    "teacher",
    "robot",
    "truth",
    "verdict",
    "reason",
    "controller_verdict",
    "best_other",
    "damage",
    "damage_found",
    "verdict_since",
)
_WHOLE = ("trial",)
_FLAGS = (
    "found",
    "chosen",
    "parts_in_place",
    "topology_right",
    "identifiable",
    "posterior_holds_truth",
    "damage_named_right",
    "damage_named_right_first",
    "damage_kind_right",
    "alarm_withdrawn",
    "left_topology_right",
    "left_identifiable",
)


class DamagedError(Exception):
    """A trial's file is not what was written."""


def encode(result: TrialResult) -> tuple[bytes, bytes]:
    """A trial as the contents of its ``.npz`` and its ``.parquet``; equal trials give equal bytes.

    Raises:
        TypeError: If an array holds Python objects, which could be read back only by unpickling.
    """
    arrays = _npz(result.arrays)
    metadata = {_ARRAYS: _digest(arrays), _ROWS: _digest(_canonical(result.rows))}
    table = _table(result.rows).replace_schema_metadata(metadata)
    sink = io.BytesIO()
    pq.write_table(table, sink, write_page_checksum=True)
    return arrays, sink.getvalue()


def decode(arrays: bytes, table: bytes) -> TrialResult:
    """The trial back from both files.

    Raises:
        DamagedError: If either is truncated or altered.
    """
    rows = decode_rows(table, arrays=arrays)
    try:
        with np.load(io.BytesIO(arrays), allow_pickle=False) as archive:
            loaded = {name: archive[name] for name in archive.files}
    except (ValueError, OSError, EOFError, KeyError, zipfile.BadZipFile) as error:
        raise DamagedError(f"the arrays cannot be read ({error})") from error
    return TrialResult(rows=rows, arrays=loaded)


def decode_rows(table: bytes, *, arrays: bytes | None = None) -> tuple[dict[str, Any], ...]:
    """The rows alone, checked; with ``arrays``, that file's checksum is checked too.

    Raises:
        DamagedError: If the table, or the arrays' file, is truncated or altered.
    """
    try:
        # By itself, not as a data set, and in this thread: small files are read three times as fast.
        file = pq.ParquetFile(pa.BufferReader(table), page_checksum_verification=True)
        read = file.read(use_threads=False)
        metadata = read.schema.metadata or {}
        rows = tuple(read.to_pylist())
        sound = metadata.get(_ROWS) == _digest(_canonical(rows))
    except Exception as error:  # a flipped byte may change names and types, and so raise anything
        raise DamagedError("the table cannot be read") from error
    if not sound:
        raise DamagedError("the table's rows are not those that were written")
    if arrays is not None and metadata.get(_ARRAYS) != _digest(arrays):
        raise DamagedError("the arrays are not those that were written")
    return rows


def _npz(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    # np.savez takes names as keyword arguments, so "file" could not be one; it makes no more than this.
    sink = io.BytesIO()
    with zipfile.ZipFile(sink, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, array in arrays.items():
            values = np.asarray(array)
            if values.dtype.hasobject:
                raise TypeError(f"array '{name}' holds Python objects; store numbers, booleans or text")
            contents = io.BytesIO()
            np.lib.format.write_array(contents, values, allow_pickle=False)
            archive.writestr(_entry(name), contents.getbuffer())
    return sink.getvalue()


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(f"{name}.npy")  # dated 1980: the clock does not enter the bytes
    entry.compress_type = zipfile.ZIP_DEFLATED
    return entry


def _table(rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    names = list(dict.fromkeys(name for row in rows for name in row))
    columns = {name: [row.get(name) for row in rows] for name in names}
    return pa.table({name: pa.array(values, type=_type(name, values)) for name, values in columns.items()})


def _type(name: str, values: Sequence[object]) -> pa.DataType:
    # Known columns keep their type where every value is missing, so that all trials' tables fit together.
    if name in _TEXT or any(isinstance(value, str) for value in values):
        return pa.string()
    if name in _FLAGS or any(isinstance(value, bool | np.bool_) for value in values):
        return pa.bool_()
    if name in _WHOLE:
        return pa.int64()
    return pa.float64()


def _canonical(rows: Sequence[Mapping[str, Any]]) -> bytes:
    names = list(dict.fromkeys(name for row in rows for name in row))
    table = [[_plain(row.get(name), name) for name in names] for row in rows]
    return json.dumps([names, table]).encode()


def _plain(value: Any, name: str) -> Any:
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, bool | np.bool_):
        return bool(value)
    return int(value) if name in _WHOLE else float(value)


def _digest(contents: bytes) -> bytes:
    return hashlib.sha256(contents).hexdigest().encode()
