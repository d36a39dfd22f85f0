"""Small pieces of a page: every text passes through here and is escaped."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Iterable, Sequence
from pathlib import Path


def text(value: object) -> str:
    """A value as safe text."""
    return html.escape(str(value))


def prose(value: str) -> str:
    """A sentence as safe text whose equations do not break across lines."""
    return text(re.sub(r"\b([Np]) ([=<]) ", "\\1\N{NO-BREAK SPACE}\\2\N{NO-BREAK SPACE}", value))


def number(value: float | None, digits: int = 3) -> str:
    """A number rounded for readers, with the number itself for programs; an empty dash for None."""
    if value is None:
        return '<span class="none">–</span>'
    shown = f"{value:.0f}" if abs(value) >= 10**digits else f"{value:#.{digits}g}"
    shown = shown.rstrip(".").replace("-", "\N{MINUS SIGN}")
    return f'<data value="{value!r}">{text(shown)}</data>'


def table(header: Sequence[str], rows: Iterable[Sequence[str]], *, css: str = "") -> str:
    """A table; cells are HTML already."""
    head = "".join(f"<th>{cell}</th>" for cell in header)
    body = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>\n" for row in rows)
    inside = f"<thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody>"
    return f'<div class="scroll"><table class="{css}">{inside}</table></div>'


def figure(drawing: str, caption: str) -> str:
    """A picture with its caption; both HTML already."""
    return f"<figure>{drawing}<figcaption>{caption}</figcaption></figure>"


def section(title: str, *parts: str, lead: str = "") -> str:
    """A section; the lead is one sentence below the title."""
    opening = f'<p class="lead">{lead}</p>' if lead else ""
    return f"<section><h2>{text(title)}</h2>{opening}{''.join(parts)}</section>\n"


def details(summary: str, content: str) -> str:
    """Something to unfold."""
    return f"<details><summary>{text(summary)}</summary>{content}</details>"


def data_uri(content: bytes, kind: str) -> str:
    """Bytes as part of the page."""
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"


def page(title: str, body: str) -> str:
    """A whole page that needs nothing from elsewhere."""
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{text(title)}</title>\n<style>{_css()}</style>\n</head>\n<body>\n<main>\n{body}</main>\n</body>\n</html>\n"
    )


def _css() -> str:
    return Path(__file__).with_name("page.css").read_text(encoding="utf-8")
