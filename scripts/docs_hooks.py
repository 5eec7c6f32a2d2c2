"""What the site has beyond the files in docs/: pages that are made when it is built, of the notebooks and of the command
line, and links out of it."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parent.parent
NOTEBOOKS = "tutorials/*.ipynb"
_LINK = re.compile(r"(?<!!)\[([^\]]*)\]\(([^)#:\s]+)(#[^)]*)?\)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages of the notebooks and that of the command line."""
    for notebook in sorted(Path(config.docs_dir).glob(NOTEBOOKS)):
        text = "".join(_cells(json.loads(notebook.read_text(encoding="utf-8"))))
        name = notebook.relative_to(config.docs_dir).with_suffix(".md").as_posix()
        files.append(File.generated(config, name, content=text))
    files.append(File.generated(config, "reference/command-line.md", content="".join(_commands())))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Show links to files outside docs/ as their text alone, and check that the files exist; those to a notebook lead
    to its page."""

    def replaced(match: re.Match[str]) -> str:
        text, target, anchor = match[1], match[2], match[3] or ""
        if target.endswith(".ipynb"):
            return f"[{text}]({target.removesuffix('.ipynb')}.md{anchor})"
        file = Path(os.path.normpath(Path(config.docs_dir, page.file.src_uri).parent / target))
        if file.is_relative_to(config.docs_dir):
            return match[0]
        if not file.is_relative_to(ROOT) or not file.exists():
            raise PluginError(f"{page.file.src_uri}: there is no {target}")
        return text

    return _LINK.sub(replaced, markdown)


def _cells(notebook: dict[str, Any]) -> Iterator[str]:
    """A notebook as Markdown, with what its cells print and draw."""
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            yield f"{source}\n\n"
            continue
        yield f"```python\n{source}\n```\n\n"
        for output in cell["outputs"]:
            if "text" in output:
                yield f"```text\n{''.join(output['text'])}\n```\n\n"
            for kind, data in output.get("data", {}).items():
                if kind.startswith("image/"):
                    encoded = "".join(data).replace("\n", "")
                    yield f'<img alt="What the cell draws" src="data:{kind};base64,{encoded}">\n\n'


def _commands() -> Iterator[str]:
    """Each command's arguments and options, from the program itself."""
    import typer.main

    from executive.cli import app

    group: Any = typer.main.get_command(app)
    yield "# Command line\n`--help` after a command prints the same. [Exit codes](exit-codes.md) have a page.\n\n"
    yield f"Before the command:\n\n{_options(group)}"
    commands = dict(group.commands)
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            del commands[name]
            commands |= {f"{name} {inner}": each for inner, each in command.commands.items()}
    for name, command in sorted(commands.items()):
        yield f"\n## executive {name}\n{command.help or ''}\n\n{_options(command)}"


def _options(command: Any) -> str:
    lines = ["| | | default |", "|---|---|---|"]
    for parameter in command.params:
        if parameter.hidden or parameter.name == "help":
            continue
        names = " ".join(f"`{name}`" for name in (*parameter.opts, *parameter.secondary_opts))
        default = "" if parameter.default in (None, False) or parameter.required else f"`{parameter.default}`"
        help_text = (parameter.help or "").replace("|", "\\|").replace("\n", " ")
        lines.append(f"| {names} | {help_text} | {default} |")
    return "\n".join(lines) + "\n"
