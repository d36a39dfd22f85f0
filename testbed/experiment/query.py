"""Questions to runs, in SQL: DuckDB over their tables, in memory and behind a locked door.

A query sees the tables and nothing else: it reads and writes no file, loads no extension and no variable of this
process.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

import duckdb
import pyarrow as pa

from testbed.errors import UserError, did_you_mean
from testbed.experiment.columns import TABLES
from testbed.experiment.tables import Damage, Progress, read_tables

_READING = (duckdb.StatementType.SELECT, duckdb.StatementType.EXPLAIN, duckdb.StatementType.MULTI)
_DOOR = {
    "python_enable_replacements": False,  # no table names that are variables of ours
    "temp_directory": "",  # what does not fit in memory is refused, not written
    "allow_community_extensions": False,
    "autoinstall_known_extensions": False,
    "autoload_known_extensions": False,
    "enable_external_access": False,  # no files, no network, no extensions
    "lock_configuration": True,  # and none of this can be undone
}
_HELP = "`testbed query` without a query lists all tables and columns"


@dataclass(frozen=True)
class Answer:
    """What a query found.

    Attributes:
        names: Of the columns; a name that comes again has a number.
        rows: In the query's order.
        damaged: Trials that were left out because their file is damaged.
    """

    names: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    damaged: tuple[Damage, ...] = ()

    def as_json(self) -> str:
        """A list with an object a row; what JSON cannot say (NaN, infinity) is null."""
        rows = (
            {name: _plain(value) for name, value in zip(self.names, row, strict=True)} for row in self.rows
        )
        lines = ",\n".join(json.dumps(row, ensure_ascii=False, default=str) for row in rows)
        return f"[\n{lines}\n]" if lines else "[]"

    def as_csv(self) -> str:
        """A header and a line a row; missing values are empty, flags ``true`` and ``false``."""
        plain = ([str(each).lower() if isinstance(each, bool) else each for each in row] for row in self.rows)
        return "".join(f"{_csv_line(row)}\n" for row in (self.names, *plain))


def ask(folders: Sequence[Path], sql: str, progress: Progress = lambda done, total: None) -> Answer:
    """Answer one question about the finished trials of run directories.

    Args:
        folders: Run directories; the column ``run`` tells them apart.
        sql: One statement that reads, in DuckDB's dialect, from the tables of :mod:`testbed.experiment.columns`.
        progress: Told how many files are read, where it takes long.

    Raises:
        UserError: If a folder is no run, or the query is wrong or asks for more than to read these tables.
    """
    _check_reads(sql)
    tables = read_tables(folders, progress)
    with _locked(tables.by_name) as connection:
        try:
            found = connection.execute(sql)
            names, rows = [column[0] for column in found.description or ()], found.fetchall()
        except duckdb.Error as error:
            raise _explained(error, sql) from None
    return Answer(_distinct(names), tuple(rows), tables.damaged)


def _check_reads(sql: str) -> None:
    """Say what is wrong before anything is read from the disk."""
    try:
        with duckdb.connect(":memory:") as connection:
            statements = connection.extract_statements(sql)
    except duckdb.Error as error:
        raise _explained(error, sql) from None
    if len(statements) != 1:
        what = "the query is empty" if not statements else f"there are {len(statements)} queries"
        raise UserError(what, 'give one, such as "SELECT student, avg(score) FROM verdicts GROUP BY student"')
    if statements[0].type not in _READING:
        raise UserError(
            f"a {statements[0].type.name} statement changes something",
            "a run is only read: begin with SELECT or FROM",
        )


def _locked(tables: dict[str, pa.Table] | Any) -> duckdb.DuckDBPyConnection:
    connection = duckdb.connect(":memory:")
    for name, table in tables.items():
        connection.register("arriving", table)
        connection.execute(f'CREATE TABLE "{name}" AS FROM arriving')
        connection.unregister("arriving")
    for setting, value in _DOOR.items():
        connection.execute(f"SET {setting} = {value!r}")
    return connection


def _explained(error: duckdb.Error, sql: str) -> UserError:
    """DuckDB's complaint in one line, with a mend."""
    text = str(error).partition("\n\nLINE")[0]
    said = re.sub(r"^[\w ]+ Error: ", "", text.splitlines()[0] if text else type(error).__name__).rstrip(
        "!. "
    )
    if match := re.match(r'Referenced column "(.+?)" not found', said):
        known = re.findall(r'"(\w+)"', text.partition("Candidate bindings:")[2])
        mend = did_you_mean(match[1], known, kind="columns near it") if known else _HELP
        quoted = f'"{match[1]}"' in sql
        return UserError(
            f"there is no column '{match[1]}'", mend + ("; text stands in 'single quotes'" if quoted else "")
        )
    if match := re.match(r"Table with name (.+?) does not exist", said):
        return UserError(f"there is no table '{match[1]}'", did_you_mean(match[1], TABLES, kind="tables"))
    if isinstance(error, duckdb.PermissionException):
        return UserError(said, "a query sees the tables of its runs and no files")
    near = text.partition("Did you mean ")[2].rstrip("?\n ")
    return UserError(f"the query cannot be answered: {said}", f"did you mean {near}?" if near else _HELP)


def _distinct(names: Sequence[str]) -> tuple[str, ...]:
    """The names, with a number where one comes again."""
    found: list[str] = []
    for name in names:
        number, distinct = 1, name
        while distinct in found:
            distinct, number = f"{name}_{number}", number + 1
        found.append(distinct)
    return tuple(found)


def _csv_line(row: Sequence[Any]) -> str:
    sink = io.StringIO()
    csv.writer(sink, lineterminator="\r\n").writerow(row)  # what ends lines is quoted: here either character
    return sink.getvalue().removesuffix("\r\n")


def _plain(value: Any) -> Any:
    if isinstance(value, Decimal):
        return float(value)
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value
