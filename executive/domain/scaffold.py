"""A new domain folder: `executive new NAME`. It runs as it is, and its files explain every key that they may have."""

from __future__ import annotations

import os
import re
import shutil
from dataclasses import dataclass
from pathlib import Path

from executive.domain.loader import list_domains, load_domain
from executive.errors import DomainError, InputError

TEMPLATE = Path(__file__).parents[1] / "templates" / "domain"
"""A domain in itself, by the name of `PLACEHOLDER`."""

PLACEHOLDER, TITLE = "my-domain", "My domain"
LONGEST = 60
"""Characters of a name."""


@dataclass(frozen=True, slots=True)
class Created:
    """A domain folder that was made, its files (sorted), and what can be typed next."""

    folder: Path
    files: tuple[Path, ...]
    commands: tuple[str, ...]


def create(name: str, parent: Path = Path()) -> Created:
    """Make the folder `parent`/`name` with a domain of that name in it. What is there already is left as it is.

    Raises:
        InputError: the name cannot be a domain's, is taken, or the folder cannot be made.
    """
    folder = parent / checked(name)
    if not os.path.isdir(parent):
        raise InputError("there is no such folder", file="--in", key=str(parent))
    try:
        folder.mkdir()
    except FileExistsError:
        raise InputError("is there already, and is left as it is; choose another name", file=folder) from None
    except OSError as error:
        raise InputError(f"cannot be made ({error.strerror})", file=folder) from None
    try:
        files = tuple(_fill(source, folder, name) for source in sorted(TEMPLATE.rglob("*")) if source.is_file())
        load_domain(folder)
    except BaseException as error:  # a folder that is not whole is no domain
        shutil.rmtree(folder, ignore_errors=True)
        if isinstance(error, OSError):
            raise InputError(f"cannot be written ({error.strerror})", file=folder) from None
        if isinstance(error, DomainError):  # its name is a word of PDDL
            raise InputError(error.message) from None
        raise
    # No model knows this domain yet, so that the simulator's truth is asked.
    command = f"executive run {folder.as_posix()} --estimator oracle"
    return Created(folder, files, (command, f"{command} --fault drop@2", f"{command} --problem one-block"))


def checked(name: str) -> str:
    """The name, once it is certain that it can be one in a path and on the command line alike.

    Raises:
        InputError: it is not, or a domain that comes along has it.
    """
    if not re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", name) or len(name) > LONGEST:
        words = re.findall(r"[a-z0-9]+", name.lower())
        better = "-".join(words)[:LONGEST].rstrip("-").lstrip("0123456789-")
        hint = f"; did you mean {better!r}?" if better else ""
        raise InputError(
            f"{name!r} is no name for a domain: lower-case letters and digits, hyphens between them, a letter first, "
            f"at most {LONGEST} in all, such as {PLACEHOLDER}{hint}"
        )
    if name in list_domains():
        raise InputError(f"a domain of the name {name!r} comes with Executive; choose another name")
    return name


def _fill(source: Path, folder: Path, name: str) -> Path:
    target = folder / source.relative_to(TEMPLATE)
    target.parent.mkdir(exist_ok=True)
    text = source.read_text(encoding="utf-8").replace(PLACEHOLDER, name)
    target.write_text(text.replace(TITLE, name.replace("-", " ").capitalize()), encoding="utf-8")
    return target
