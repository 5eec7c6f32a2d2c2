"""A language model in this process that words questions (`executive.s3e.translators.Writer`)."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from executive.s3e.checkpoint import Checkpoint, find
from executive.s3e.loading import load_language_model
from executive.s3e.translators import Reply

MOST_TOKENS = 200
"""Of a reply; a question has some twenty."""

TEMPERATURE = 0.8
"""Of every attempt but the first, which takes the likeliest token each time."""

_SAMPLE = 1 << 20
"""Bytes at either end of a file of weights that tell one model from another of the same shape."""


class LocalWriter:
    """Any causal language model that transformers loads: safetensors, never code of its own.

    Args:
        model: a checkpoint's folder, or its id on the model hub.
        device, dtype: as for `executive.s3e.loading.load`.

    Raises:
        InputError: there is no such checkpoint, it is broken, or it is no causal language model.
    """

    def __init__(self, model: str | Path, *, device: str = "auto", dtype: str = "auto") -> None:
        checkpoint = find(model, pictures=False)
        loaded = load_language_model(checkpoint, device, dtype)
        self._model, self._tokenizer, self._device = loaded.model, loaded.processor, loaded.device
        self._name = f"{checkpoint.name}@{_digest(checkpoint)}"

    @property
    def name(self) -> str:
        """The folder's own name or the hub's id, and a digest by which other weights in the same place are noticed."""
        return self._name

    def write(self, system: str, prompts: Sequence[str], attempt: int) -> list[Reply]:
        """A reply to each prompt on its own; see `executive.s3e.translators.Writer`. The same prompt and attempt get
        the same reply, whatever else is asked."""
        return [self._reply(system, prompt, attempt) for prompt in prompts]

    def _reply(self, system: str, prompt: str, attempt: int) -> Reply:
        import torch

        try:
            tokens = self._tokenizer(self._render(system, prompt), add_special_tokens=False, return_tensors="pt")
            tokens = tokens.to(self._device)
            with torch.random.fork_rng(), torch.inference_mode():
                torch.manual_seed(int.from_bytes(hashlib.sha256(f"{attempt} {prompt}".encode()).digest()[:8], "big"))
                drawn = {"do_sample": True, "temperature": TEMPERATURE} if attempt else {"do_sample": False}
                written = self._model.generate(
                    **tokens, max_new_tokens=MOST_TOKENS, pad_token_id=self._tokenizer.eos_token_id, **drawn
                )
            reply = written[0, tokens["input_ids"].shape[1] :]
            return Reply(self._tokenizer.decode(reply, skip_special_tokens=True))
        except Exception as error:  # out of memory, say: the other prompts may do better
            return Reply(error=f"{type(error).__name__}: {error}")

    def _render(self, system: str, prompt: str) -> str:
        """The conversation as the model was trained to see it; plain text for a model that has no chat template."""
        if not self._tokenizer.chat_template:
            return f"{self._tokenizer.bos_token or ''}{system}\n\n{prompt}\n"
        try:
            return self._template([{"role": "system", "content": system}, {"role": "user", "content": prompt}])
        except Exception:  # templates say in many ways that they have no system role: it goes before the prompt then
            return self._template([{"role": "user", "content": f"{system}\n\n{prompt}"}])

    def _template(self, messages: Sequence[dict[str, str]]) -> str:
        options: dict[str, Any] = {"add_generation_prompt": True, "tokenize": False, "enable_thinking": False}
        return str(self._tokenizer.apply_chat_template(messages, **options))


def _digest(checkpoint: Checkpoint) -> str:
    """Eight hexadecimal digits over the files of a checkpoint: their names and sizes, and both ends of each."""
    digest = hashlib.sha256()
    for file in sorted(path for end in ("safetensors", "json", "jinja") for path in checkpoint.folder.glob(f"*.{end}")):
        size = file.stat().st_size
        with file.open("rb") as stream:
            digest.update(f"{file.name} {size}\n".encode() + stream.read(_SAMPLE))
            stream.seek(max(0, size - _SAMPLE))
            digest.update(stream.read())
    return digest.hexdigest()[:8]
