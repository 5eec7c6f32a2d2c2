"""A checkpoint's model and processor, loaded through transformers' own Auto classes: safetensors, never remote code.

Pictures are all that is ever shown, so that a family whose video part needs torchvision is loaded without that part.
"""

from __future__ import annotations

import logging
import os
import platform
import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from executive.errors import ExecutiveError, InputError, nearest
from executive.s3e.backends.checkpoint import CONFIG, PROCESSORS, Checkpoint, read_object
from executive.s3e.backends.packages import EXTRAS, importing, needed, unloadable

if TYPE_CHECKING:
    import torch

DTYPES = ("auto", "float32", "bfloat16", "float16")
DEVICES = ("auto", "cpu", "cuda", "mps")

GPUS = ("/dev/nvidiactl", "/dev/nvmap", "/dev/dxg", "/dev/kfd")
"""What drivers that torch can use put there on Linux: NVIDIA's on a PC and on a Jetson, WSL2's, AMD's."""


@dataclass(frozen=True, slots=True)
class Loaded:
    """A model ready to answer, and the processor that turns a prompt and pictures into what it takes; of a language
    model, its tokenizer."""

    model: Any
    processor: Any
    device: str
    dtype: str


def load(checkpoint: Checkpoint, device: str = "auto", dtype: str = "auto") -> Loaded:
    """Load a checkpoint.

    Args:
        device: "cpu", "cuda", "cuda:1", "mps"; "auto" takes CUDA, else MPS, else the CPU.
        dtype: "float32", "bfloat16", "float16"; "auto" keeps what the weights are stored in where the device computes
            with it at full speed, which few CPUs do for 16 bits, and takes float32 otherwise.

    Raises:
        InputError: the device or the dtype is none, or the checkpoint is no image-text-to-text model or a broken one.
        MissingError: the checkpoint's family needs a package that is not installed, or torch or transformers is broken.
    """
    with importing():
        import torch
        from transformers import AutoModelForImageTextToText
        from transformers.models.auto.modeling_auto import MODEL_FOR_IMAGE_TEXT_TO_TEXT_MAPPING_NAMES as FAMILIES

    place = choose_device(device)
    kind = choose_dtype(dtype, place, checkpoint.half)
    _check_family(checkpoint, FAMILIES, "image-text-to-text", "llava_onevision, smolvlm, qwen2_5_vl or fast_vlm")
    processor = load_processor(checkpoint)
    model = _load_model(checkpoint, AutoModelForImageTextToText, getattr(torch, kind), place)
    return Loaded(model, processor, place, kind)


def load_language_model(checkpoint: Checkpoint, device: str = "auto", dtype: str = "auto") -> Loaded:
    """Load a checkpoint that writes text and sees nothing. Arguments and errors are those of `load`."""
    with importing():
        import torch
        from transformers import AutoModelForCausalLM, AutoTokenizer
        from transformers.models.auto.modeling_auto import MODEL_FOR_CAUSAL_LM_MAPPING_NAMES as FAMILIES

    place = choose_device(device)
    kind = choose_dtype(dtype, place, checkpoint.half)
    _check_family(checkpoint, FAMILIES, "causal language", "llama, qwen3 or smollm3")
    with _in_one_line(checkpoint, "its tokenizer cannot be loaded"), quiet():
        tokenizer = AutoTokenizer.from_pretrained(checkpoint.folder, **_LOCAL)
    model = _load_model(checkpoint, AutoModelForCausalLM, getattr(torch, kind), place)
    return Loaded(model, tokenizer, place, kind)


def choose_device(wanted: str) -> str:
    """The device to compute on, as torch writes it.

    Raises:
        InputError: torch knows no such device, or has it not.
    """
    with importing():
        import torch

    there = {"cpu": 1, "cuda": torch.cuda.device_count(), "mps": int(torch.backends.mps.is_available())}
    if wanted == "auto":
        return "cuda" if there["cuda"] else "mps" if there["mps"] else "cpu"
    kind, _, index = wanted.partition(":")
    if kind not in there:
        raise InputError(f"there is no device {wanted!r}; {nearest(wanted, DEVICES)}", key="device")
    if (index and not index.isdecimal()) or int(index or 0) >= there[kind]:
        have = ", ".join(f"{name}:{n}" if n else name for name, count in there.items() for n in range(count))
        raise InputError(f"this machine has no {wanted} that torch can use; it has {have}", key="device")
    return wanted


def has_gpu() -> bool:
    """Whether "auto" takes a GPU. Where there is no sign of one, torch is not imported to find that out."""
    mac = sys.platform == "darwin" and platform.machine() == "arm64"
    return (mac or any(map(os.path.exists, GPUS))) and choose_device("auto") != "cpu"


def choose_dtype(wanted: str, device: str, half: bool) -> str:
    """The dtype to compute in, by torch's name, for weights that are stored in 16 bits (`half`) or not.

    Raises:
        InputError: `wanted` is none.
    """
    import torch

    if wanted not in DTYPES:
        raise InputError(f"there is no dtype {wanted!r} here; {nearest(wanted, DTYPES)}", key="dtype")
    if wanted != "auto":
        return wanted
    if not half:
        return "float32"
    if device == "cpu":
        return "bfloat16" if native_bfloat16() else "float32"
    if device.startswith("cuda") and torch.cuda.is_bf16_supported(including_emulation=False):
        return "bfloat16"
    return "float16"


def native_bfloat16() -> bool:
    """Whether this machine's CPU multiplies in bfloat16 by itself. Where it does not, torch emulates, some 100 times
    slower than float32."""
    with importing():
        import torch

    able = torch.cpu.get_capabilities()
    return any(able.get(name, False) for name in ("amx_bf16", "avx512_bf16", "bf16", "sve_bf16"))


def load_processor(checkpoint: Checkpoint) -> Any:
    """The checkpoint's processor, checked to have what a look needs.

    Raises:
        InputError: it is no processor for pictures and chat, or a broken one.
        MissingError: it needs a package that is not installed.
    """
    with importing():
        from transformers import AutoProcessor

    with _in_one_line(checkpoint, "its processor cannot be loaded"):
        try:
            with quiet():
                processor = AutoProcessor.from_pretrained(checkpoint.folder, **_LOCAL)
        except (ImportError, ValueError) as error:  # which of them hangs on what files the checkpoint has
            if "torchvision" not in str(error).lower():
                raise
            with quiet():
                processor = _without_video(checkpoint)
    tokenizer = getattr(processor, "tokenizer", None)
    if tokenizer is None or getattr(processor, "image_processor", None) is None:
        raise InputError(f"{type(processor).__name__} does not take text and pictures together", file=checkpoint.folder)
    if not (getattr(processor, "chat_template", None) or tokenizer.chat_template):
        raise InputError(
            "has no chat template (wanted chat_template.jinja, as a model that is to be asked has)",
            file=checkpoint.folder,
        )
    if not getattr(processor, "chat_template", None):
        processor.chat_template = tokenizer.chat_template  # older checkpoints have it in tokenizer_config.json
    return processor


_LOCAL: dict[str, Any] = {"local_files_only": True, "trust_remote_code": False}


class _NoVideo:
    """Stands where a family's processor wants one for videos, and is never shown any."""

    model_input_names: tuple[str, ...] = ()
    num_frames, fps = 1, 1  # arguments of SmolVLM's chat template, used for videos alone


def _without_video(checkpoint: Checkpoint) -> Any:
    """The processor as AutoProcessor would make it, with nothing in the place of its video part (which only exists
    with torchvision)."""
    import transformers
    from transformers import AutoConfig, AutoFeatureExtractor, AutoImageProcessor, AutoTokenizer
    from transformers.models.auto.processing_auto import PROCESSOR_MAPPING

    folder = checkpoint.folder
    names = [read_object(folder / file, "").get("processor_class") for file in PROCESSORS if (folder / file).is_file()]
    named = next((getattr(transformers, name, None) for name in names if isinstance(name, str)), None)
    family = named or PROCESSOR_MAPPING[type(AutoConfig.from_pretrained(folder, **_LOCAL))]

    def check(self: Any, name: str, part: Any) -> Any:
        return type(part) if isinstance(part, _NoVideo) else family.check_argument_for_proper_class(self, name, part)

    own = {"check_argument_for_proper_class": check, "__repr__": object.__repr__}  # its own repr writes every part
    still: Any = type(family.__name__, (family,), own)
    makers = {
        "image_processor": AutoImageProcessor,
        "tokenizer": AutoTokenizer,
        "feature_extractor": AutoFeatureExtractor,
    }
    parts = [
        _NoVideo() if name == "video_processor" else makers[name].from_pretrained(folder, **_LOCAL)
        for name in still.get_attributes()
    ]
    settings, _ = still.get_processor_dict(folder, **_LOCAL)
    return still.from_args_and_dict(parts, settings)


def _check_family(checkpoint: Checkpoint, families: Collection[str], what: str, such: str) -> None:
    from transformers import AutoConfig

    kind, file = checkpoint.model_type, checkpoint.folder / CONFIG
    if kind not in families:
        code = "; it brings code of its own, which is never run" if "auto_map" in read_object(file, "") else ""
        raise InputError(
            f"is a {kind!r}, which transformers knows as no {what} model{code}; wanted one such as {such}",
            file=file,
        )
    with _in_one_line(checkpoint, "its config cannot be read", CONFIG), quiet():
        config = AutoConfig.from_pretrained(checkpoint.folder, **_LOCAL)
    if getattr(config, "is_encoder_decoder", False):
        raise InputError(
            f"is a {kind!r}, an encoder-decoder model; wanted a decoder, which goes on from the prompt", file=file
        )


def _load_model(checkpoint: Checkpoint, family: Any, dtype: torch.dtype, device: str) -> Any:
    with _in_one_line(checkpoint, "its model cannot be loaded"), quiet():
        model, report = family.from_pretrained(
            checkpoint.folder,
            dtype=dtype,
            use_safetensors=True,
            output_loading_info=True,
            ignore_mismatched_sizes=True,  # said below, in one line
            **_LOCAL,
        )
    # Whatever is not in the weights would be drawn at random, and the model would answer at random.
    for name, stored, wanted in sorted(report["mismatched_keys"]):
        shapes = f"{tuple(stored)} in the weights, {tuple(wanted)} by {CONFIG}"
        raise InputError(f"its weights are another model's: {name} is {shapes}", file=checkpoint.folder)
    missing = sorted(report["missing_keys"])
    if missing:
        raise InputError(
            f"its weights lack {len(missing)} of the model's, such as {missing[0]}", file=checkpoint.folder
        )
    with _in_one_line(checkpoint, f"its model does not fit on {device}"):
        model = model.to(device)
    return model.eval().requires_grad_(False)


@contextmanager
def _in_one_line(checkpoint: Checkpoint, what: str, file: str = "") -> Iterator[None]:
    """Turn whatever a library raises for a broken checkpoint into one line. There is no telling what that is: files
    of strangers reach every parser in it."""
    try:
        yield
    except ExecutiveError:
        raise
    except ImportError as error:
        package = next((name for name in EXTRAS if name in str(error).lower()), None)
        kind = f"{checkpoint.name}: a {checkpoint.model_type}"
        raise (unloadable(kind, error) if package is None else needed(package, kind)) from None
    except Exception as error:
        reason = next((line.strip() for line in str(error).splitlines() if line.strip()), "")
        raise InputError(f"{what} ({type(error).__name__}: {reason[:300]})", file=checkpoint.folder / file) from error


@contextmanager
def quiet() -> Iterator[None]:
    """Keep transformers' progress bars and advice off the terminal; its errors are raised anyway."""
    from transformers.utils import logging as chatter

    level, bars = chatter.get_verbosity(), chatter.is_progress_bar_enabled()
    chatter.set_verbosity(logging.ERROR)
    chatter.disable_progress_bar()
    try:
        yield
    finally:
        chatter.set_verbosity(level)
        if bars:
            chatter.enable_progress_bar()
