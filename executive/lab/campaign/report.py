"""The report of a campaign in its folder: numbers, tables, figures, and a page of all that."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from executive.errors import InputError
from executive.lab.campaign import page, plots
from executive.lab.campaign.results import Results
from executive.lab.campaign.tables import by_place, markdown
from executive.lab.collection.dataset import write_atomically

PAGE, TEXT, NUMBERS = "report.html", "report.md", "report.json"


def write(folder: Path, results: Results) -> dict[str, Any]:
    """Writes everything into the campaign's folder, and returns the content of `report.json`.

    Raises:
        InputError: there are no episodes yet, or the folder cannot be written to.
    """
    if not results.cells:
        raise InputError("has no episodes yet", file=folder)
    made = results.document()
    figures: dict[str, tuple[str, bytes]] = {}
    try:
        places = by_place(results.cells)
        for place, cells in places.items():
            tail, about = ("", "") if len(places) == 1 else (f"-{re.sub(r'[^A-Za-z0-9.-]+', '-', place)}", f": {place}")
            for name, heading, text, png in (
                ("metrics", "Every metric", "With 95 % intervals; what each is stands below.", plots.metrics(cells)),
                ("outcomes", "How the episodes ended", "In percent of the episodes.", plots.outcomes(cells)),
            ):
                write_atomically(folder / f"{name}{tail}.png", png)
                figures[f"{heading}{about}"] = (text, png)
        write_atomically(folder / NUMBERS, (json.dumps(made, indent=2) + "\n").encode())
        write_atomically(folder / TEXT, markdown(results).encode())
        write_atomically(folder / PAGE, page.page(results, figures).encode())
    except OSError as error:
        raise InputError(f"cannot be written to ({error.strerror})", file=folder) from None
    return made
