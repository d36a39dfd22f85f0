"""What the commands of the bench show on a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from testbed.errors import shown_path
from testbed.hardware.doctor.checks import Check, Outcome
from testbed.hardware.operating.find import FoundCamera, FoundPort

_MARKS = {
    Outcome.PASSED: "[green]passed[/]",
    Outcome.FAILED: "[bold red]FAILED[/]",
    Outcome.SKIPPED: "[dim]left out[/]",
}


def port_table(ports: Iterable[FoundPort]) -> Table:
    """Serial ports and who answers there."""
    table = _table(
        "Serial ports", "port", "USB", "serial number", "who answers", "firmware", "servos", "tilt"
    )
    for port in ports:
        info, board = port.info, port.identity
        usb = "" if info.vendor is None else f"{info.vendor:04x}:{info.product or 0:04x}"
        head = [info.path, usb, info.serial_number or ""]
        if board is None:
            why = "" if port.failure is None else port.failure.outcome
            table.add_row(*map(escape, head), f"[yellow]{why}[/]", "", "", "")
            continue
        who = f"[bold]{escape(board.board_id or 'unnamed')}[/]  {board.unique_id}"
        version = ".".join(map(str, board.firmware))
        tilt = "yes" if board.imu else "no"
        table.add_row(*map(escape, head), who, version, str(len(board.limits)), tilt)
    return table


def camera_table(cameras: Iterable[FoundCamera]) -> Table:
    """Cameras and where their thumbnails are."""
    table = _table("Cameras", "camera", "image", "what it sees now")
    for camera in cameras:
        size = "" if camera.size is None else f"{camera.size[0]} x {camera.size[1]}"
        if camera.thumbnail is not None:
            seen = escape(shown_path(camera.thumbnail))
        else:
            seen = f"[yellow]{escape(str(camera.failure or 'nothing yet'))}[/]"
        table.add_row(escape(camera.id), size, seen)
    return table


def check_table(checks: Iterable[Check]) -> Table:
    """Checks, each with what was found, and the mend below where it failed."""
    table = _table("The bench", "", "check", "", "found")
    last = None
    for check in checks:
        found = escape(check.found)
        if check.mend:
            found += f"\n[yellow]{escape(check.mend)}[/]"
        about = "" if check.about == last else f"[bold]{escape(check.about)}[/]"
        table.add_row(about, check.name, _MARKS[check.outcome], found)
        last = check.about
    return table


def sheet_table(rows: Iterable[Mapping[str, str]]) -> Table:
    """The set-up sheet: who stands where."""
    listed = list(rows)
    table = _table("Who stands where", *(listed[0] if listed else ()))
    for row in listed:
        table.add_row(*(escape(value) for value in row.values()))
    return table


def _table(title: str, *headings: str) -> Table:
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for heading in headings:
        table.add_column(heading, overflow="fold")
    return table
