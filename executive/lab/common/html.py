"""Reports: one HTML file each that opens offline, with style and pictures inside it."""

from __future__ import annotations

import base64
import functools
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

TEMPLATES = Path(__file__).with_name("templates")
DASH = "\N{EN DASH}"


def render(template: str, **values: Any) -> str:
    """Return a page from one of the `TEMPLATES`. Text among the values is escaped, but for `Markup`."""
    return _environment().get_template(f"{template}.html.j2").render(values)


def number(value: float | None, digits: int = 3) -> str:
    """Return a number as it is printed everywhere; a dash for None."""
    return DASH if value is None else f"{value:.{digits}f}"


def share(value: float | None) -> str:
    """Return a share in percent; a dash for None."""
    return DASH if value is None else f"{100 * value:.1f} %"


def code(text: str) -> Markup:
    """Return HTML of a piece of code."""
    from markupsafe import Markup

    return Markup("<code>{}</code>").format(text)


def prose(text: str) -> Markup:
    """Return HTML of a text in which backticks are around code."""
    from markupsafe import Markup, escape

    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text)))


@functools.cache
def _environment() -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    from executive.trace.record.pictures import to_jpeg

    made = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    made.filters |= {
        "base64": lambda data: base64.b64encode(data).decode(),
        "jpeg": functools.partial(to_jpeg, quality=85),
        "number": number,
        "prose": prose,
    }
    return made
