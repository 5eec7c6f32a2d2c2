"""What reports are made of: one HTML file each that opens offline, with style and pictures inside it."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

STYLE = Path(__file__).with_name("page.css")
DASH = "\N{EN DASH}"


def page(title: str, parts: Iterable[str]) -> str:
    """The whole file, of parts that are HTML already."""
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{escape(title)}</title>'
    style = f"<style>{STYLE.read_text(encoding='utf-8')}</style>"
    body = lines([f"<h1>{escape(title)}</h1>", *parts])
    return f'<!doctype html>\n<html lang="en"><head>{head}{style}</head>\n<body>\n{body}\n</body></html>\n'


def number(value: float | None, digits: int = 3) -> str:
    """A number as it is printed everywhere; a dash where there is none."""
    return DASH if value is None else f"{value:.{digits}f}"


def share(value: float | None) -> str:
    """A share in percent."""
    return DASH if value is None else f"{100 * value:.1f} %"


def tags(texts: Iterable[str]) -> str:
    """Short remarks in a line."""
    each = "".join(f'<span class="tag">{escape(text)}</span>' for text in texts)
    return f"<p>{each}</p>"


def tiles(shown: Iterable[tuple[str, str]]) -> str:
    """Numbers in large print, each with what it is."""
    each = "".join(f'<div class="tile"><b>{value}</b><span>{what}</span></div>' for value, what in shown)
    return f'<div class="tiles">{each}</div>'


def table(heads: Iterable[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; cells are HTML already."""
    head = "".join(f"<th>{escape(each)}</th>" for each in heads)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f'<div class="wide"><table><tr>{head}</tr>{body}</table></div>'


def figure(heading: str, text: str, png: bytes) -> str:
    """A picture under a heading, with what is to be seen in it."""
    data = base64.b64encode(png).decode()
    image = f'<img alt="{escape(heading)}" src="data:image/png;base64,{data}">'
    return f"<h2>{escape(heading)}</h2><p>{escape(text)}</p><figure>{image}</figure>"


def lines(parts: Iterable[str]) -> str:
    """Parts one below the other; empty ones are left out."""
    return "\n".join(part for part in parts if part)
