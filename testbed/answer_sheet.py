"""Answers of queries on a terminal, and as plain text where there is none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from decimal import Decimal
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

_UNLIMITED = 100_000  # characters; text that is no terminal's is never folded


def print_answer(console: Console, names: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    """Print an answer as a table, or row by row where the terminal is too narrow for one."""
    _widen(console)
    table = _sheet(*names, numeric=[_numeric([row[place] for row in rows]) for place in range(len(names))])
    for row in rows:
        table.add_row(*(_shown(value) for value in row))
    if Measurement.get(console, console.options.update_width(_UNLIMITED), table).maximum <= console.width:
        console.print(table)
    else:
        for row in rows:
            console.print(_one_row(names, row))
    console.print(f"{len(rows)} row{'' if len(rows) == 1 else 's'}", highlight=False)


def print_columns(console: Console, listed: Sequence[Mapping[str, str]]) -> None:
    """Print what :func:`testbed.experiment.columns.listed` lists, a sheet a table."""
    _widen(console)
    for name in dict.fromkeys(each["table"] for each in listed):
        sheet = _sheet("column", "holds", "unit", "meaning", title=name)
        for each in listed:
            if each["table"] == name:
                sheet.add_row(*(Text(each[key]) for key in ("column", "holds", "unit", "meaning")))
        console.print(sheet)


def _widen(console: Console) -> None:
    if not console.is_terminal:
        console.width = _UNLIMITED


def _one_row(names: Sequence[str], row: Sequence[Any]) -> Table:
    table = Table(box=None, show_header=False, padding=(0, 1, 0, 0))
    table.add_column(style="dim", no_wrap=True)
    for name, value in zip(names, row, strict=True):
        if value is not None:
            table.add_row(Text(name), _shown(value))
    table.add_row("", "")
    return table


def _sheet(*names: str, numeric: Sequence[bool] = (), title: str | None = None) -> Table:
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for place, name in enumerate(names):
        right = place < len(numeric) and numeric[place]
        table.add_column(Text(name), justify="right" if right else "left")
    return table


def _numeric(values: Sequence[Any]) -> bool:
    told = [value for value in values if value is not None]
    return bool(told) and all(isinstance(v, int | float | Decimal) and not isinstance(v, bool) for v in told)


def _shown(value: Any) -> Text:
    if value is None:
        return Text("")
    if isinstance(value, bool):
        return Text("true" if value else "false")
    return Text(f"{value:.6g}" if isinstance(value, float) else str(value))
