"""Where a checkpoint lies, and whether it is whole: looked into before anything heavy is imported or loaded.

A checkpoint is a folder as model hubs hold it: config.json, weights in safetensors, a tokenizer, a processor for
pictures, a chat template. Whatever is wrong with one is said in one line that names the file.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from executive.errors import InputError, MissingError
from executive.util.files import home, parse_json, read_json

CONFIG, WEIGHTS, INDEX = "config.json", "model.safetensors", "model.safetensors.index.json"
PROCESSORS = ("processor_config.json", "preprocessor_config.json")
TOKENIZERS = ("tokenizer.json", "tokenizer.model", "vocab.json", "spiece.model", "tekken.json")

_JSON = (*PROCESSORS, "tokenizer_config.json", "tokenizer.json", "generation_config.json")
"""Read again by their own readers, which do not all say which file was broken."""

_HUB_ID = re.compile(r"[A-Za-z0-9][\w.\-]*/[A-Za-z0-9][\w.\-]*")
_LARGEST = 100_000_000
"""Bytes: the most that the safetensors format allows its header. Vocabularies come to a third of that."""

_HALF = ("F16", "BF16")


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """A folder that has everything a checkpoint consists of.

    `name` is the folder's own name, or the hub's id; `half` says whether most of its weights are stored in 16 bits,
    and its config does not say that it computes in 32 nonetheless.
    """

    folder: Path
    name: str
    model_type: str
    half: bool


def find(model: str | Path, *, pictures: bool = True) -> Checkpoint:
    """The checkpoint that `model` names: a folder, or the id that it has on the model hub (`organisation/name`). One
    that was downloaded before is taken as it is, without asking the hub. Without `pictures`, a language model is meant.

    Raises:
        InputError: there is no such folder or model, or it is not a whole checkpoint; says which file is wrong.
    """
    folder = home(model)
    if os.path.isdir(folder):
        return inspect(folder, folder.resolve().name, pictures=pictures)
    if os.path.exists(folder):
        raise InputError("is a file; wanted the folder of a checkpoint, with config.json in it", file=folder)
    if not _HUB_ID.fullmatch(str(model)):
        raise InputError("no such folder; wanted a checkpoint's, with config.json in it", file=folder.absolute())
    return inspect(_from_hub(str(model), folder.absolute()), str(model), pictures=pictures)


def inspect(folder: Path, name: str, *, pictures: bool = True) -> Checkpoint:
    """A checkpoint's folder, with everything checked that can be without loading it.

    Raises:
        InputError: as `find`.
    """
    config = read_object(folder / CONFIG, "wanted a checkpoint's folder, with config.json in it")
    model_type = config.get("model_type")
    if not isinstance(model_type, str):
        raise InputError("says no model_type; wanted the config of a transformers checkpoint", file=folder / CONFIG)
    stored: Counter[str] = Counter()
    for file in _weight_files(folder):
        stored.update(check_safetensors(file))
    if not any((folder / file).is_file() for file in TOKENIZERS):
        raise InputError(f"has no tokenizer (wanted one of {', '.join(TOKENIZERS)})", file=folder)
    if pictures and not any((folder / file).is_file() for file in PROCESSORS):
        raise InputError(
            f"has no processor for pictures (wanted {' or '.join(PROCESSORS)}); does a {model_type!r} take pictures?",
            file=folder,
        )
    for file in (folder / part for part in _JSON):
        if file.is_file():
            read_object(file, "")
    half = sum(stored[kind] for kind in _HALF) * 2 > stored.total() and config.get("dtype") != "float32"
    return Checkpoint(folder, name, model_type, half)


def check_safetensors(file: Path) -> Counter[str]:
    """Whether a safetensors file is as long as its header says; how many values it stores of each dtype.

    The format: 8 bytes that give the header's length, the header (JSON), then the tensors' bytes.

    Raises:
        InputError: the file is cut off, or no such file.
    """
    try:
        size = file.stat().st_size
        with file.open("rb") as stream:
            length = int.from_bytes(stream.read(8), "little")
            if size < 8 or length > min(size - 8, _LARGEST):
                raise InputError(f"is cut off or no safetensors file ({size:,} bytes)", file=file)
            header = parse_json(stream.read(length))
        tensors = [value for key, value in header.items() if key != "__metadata__"]
        end = 8 + length + max((_count(tensor["data_offsets"][1]) for tensor in tensors), default=0)
        stored: Counter[str] = Counter()
        for tensor in tensors:
            values = 1
            for extent in tensor["shape"]:
                values = _count(values * _count(extent))
            stored[str(tensor["dtype"])] += values
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", file=file) from None
    except (ValueError, TypeError, KeyError, IndexError, AttributeError):
        raise InputError("is no safetensors file, or a damaged one: its header makes no sense", file=file) from None
    if size != end:
        what = "is cut off" if size < end else "is damaged"
        raise InputError(f"{what}: {size:,} bytes, and its header says {end:,}; download it again", file=file)
    return stored


def read_object(file: Path, wanted: str) -> Mapping[str, Any]:
    """The object in a JSON file.

    Raises:
        InputError: the file is missing (`wanted` says what it is there for), or holds no JSON object.
    """
    if not file.exists():
        raise InputError(f"no such file; {wanted}", file=file)
    value = read_json(file, largest=_LARGEST)
    if not isinstance(value, dict):
        raise InputError("is not a JSON object", file=file)
    return value


def _count(number: object) -> int:
    """A number of bytes or values, of which no file has more than 64 bits can count."""
    if type(number) is not int or not 0 <= number < 2**63:
        raise ValueError(f"{number!r:.40} is no count")
    return number


def _weight_files(folder: Path) -> list[Path]:
    if (folder / WEIGHTS).exists():
        return [folder / WEIGHTS]
    if not (folder / INDEX).exists():
        pickled = sorted(path.name for path in folder.glob("*.bin"))
        why = f"; {pickled[0]} is a pickle, which can run code, and is not read" if pickled else ""
        raise InputError(f"has no weights in safetensors (wanted {WEIGHTS} or {INDEX}){why}", file=folder)
    names = read_object(folder / INDEX, "it lists the files of the weights").get("weight_map")
    if not isinstance(names, dict) or not names or not all(isinstance(name, str) for name in names.values()):
        raise InputError("has no weight_map that names files", file=folder / INDEX)
    shards = [folder / name for name in sorted(set(names.values()))]
    for shard in shards:
        if shard.parent != folder:
            raise InputError(f"names {shard.name!r} outside of its folder", file=folder / INDEX)
        if not os.path.exists(shard):  # nor does a file whose name is too long or has a zero byte in it
            raise InputError(f"is missing, and {INDEX} names it", file=shard)
    return shards


def _from_hub(name: str, folder: Path) -> Path:
    """The folder of a model on the hub, downloaded unless it is there already: weights in safetensors, never code."""
    try:
        from huggingface_hub import constants, snapshot_download
        from huggingface_hub.errors import (
            GatedRepoError,
            HfHubHTTPError,
            LocalEntryNotFoundError,
            OfflineModeIsEnabled,
            RepositoryNotFoundError,
        )
    except ImportError as error:
        raise MissingError(f"a model from the hub needs {error.name}", command="pip install transformers") from None
    wanted = {
        "allow_patterns": ["*.json", "*.jinja", "*.txt", "*.model", "*.safetensors"],
        "ignore_patterns": ["*/*", "consolidated*"],
    }
    try:
        try:
            return Path(snapshot_download(name, local_files_only=True, **wanted))
        except LocalEntryNotFoundError:
            return Path(snapshot_download(name, **wanted))
    except GatedRepoError:
        raise InputError(
            "is on the model hub behind terms to accept first; then log in with: hf auth login", key=name
        ) from None
    except RepositoryNotFoundError:
        raise InputError(f"no such model on the hub, and no such folder ({folder})", key=name) from None
    except (LocalEntryNotFoundError, OfflineModeIsEnabled, HfHubHTTPError, OSError) as error:
        raise InputError(
            f"no such folder ({folder}), not downloaded before (looked in {constants.HF_HUB_CACHE}), and the model hub "
            f"cannot be reached ({type(error).__name__}); give a checkpoint's folder, or download the model where "
            f"there is a network: hf download {name}",
            key=name,
        ) from None
