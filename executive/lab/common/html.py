"""Building blocks of reports: one HTML file each that opens offline, with style and pictures inside it."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable, Sequence
from html import escape
from itertools import chain, repeat
from pathlib import Path

STYLE = Path(__file__).with_name("page.css")
DASH = "\N{EN DASH}"


def page(title: str, parts: Iterable[str]) -> str:
    """The whole file, from parts that are HTML already."""
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{escape(title)}</title>'
    style = f"<style>{STYLE.read_text(encoding='utf-8')}</style>"
    body = lines([f"<h1>{escape(title)}</h1>", *parts])
    return f'<!doctype html>\n<html lang="en"><head>{head}{style}</head>\n<body>\n{body}\n</body></html>\n'


def number(value: float | None, digits: int = 3) -> str:
    """A number as it is printed everywhere; a dash for None."""
    return DASH if value is None else f"{value:.{digits}f}"


def share(value: float | None) -> str:
    """A share in percent; a dash for None."""
    return DASH if value is None else f"{100 * value:.1f} %"


def tags(texts: Iterable[str]) -> str:
    """Short remarks in a line."""
    each = "".join(f'<span class="tag">{escape(text)}</span>' for text in texts)
    return f"<p>{each}</p>"


def tiles(shown: Iterable[tuple[str, str]]) -> str:
    """Numbers in large print, each with its description."""
    each = "".join(f'<div class="tile"><b>{value}</b><span>{what}</span></div>' for value, what in shown)
    return f'<div class="tiles">{each}</div>'


def prose(text: str) -> str:
    """HTML of a text in which backticks are around code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text))


def table(heads: Iterable[str], rows: Iterable[Sequence[str]], texts: int = 1, grouped: bool = False) -> str:
    """A table; cells are HTML already. The first `texts` columns are text, the others numbers; in one that is
    `grouped`, a line stands between rows whose first cells differ."""

    def row(kind: str, cells: Iterable[str], mark: str = "") -> str:
        starts = [f'<{kind} class="text">'] * texts
        told = (
            f"{start}{cell}</{kind}>" for start, cell in zip(chain(starts, repeat(f"<{kind}>")), cells, strict=False)
        )
        return f"<tr{mark}>{''.join(told)}</tr>"

    lines, before = [row("th", map(escape, heads))], None
    for cells in rows:
        is_new = grouped and before not in (None, cells[0])
        lines.append(row("td", cells, ' class="gap"' * is_new))
        before = cells[0]
    return f'<div class="wide"><table>{"".join(lines)}</table></div>'


def figure(heading: str, text: str, png: bytes) -> str:
    """A picture under a heading, with its description."""
    data = base64.b64encode(png).decode()
    image = f'<img alt="{escape(heading)}" src="data:image/png;base64,{data}">'
    return f"<h2>{escape(heading)}</h2><p>{escape(text)}</p><figure>{image}</figure>"


def lines(parts: Iterable[str]) -> str:
    """Joins parts by newlines; empty ones are left out."""
    return "\n".join(part for part in parts if part)
