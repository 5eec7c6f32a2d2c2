"""A language model in this process that words questions (`executive.s3e.questions.language_model.Writer`)."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from copy import deepcopy
from itertools import takewhile
from pathlib import Path
from typing import Any

from executive.s3e.backends.checkpoint import Checkpoint, find
from executive.s3e.backends.loading import load_language_model
from executive.s3e.questions.language_model import Reply

MOST_TOKENS = 80
"""Of a reply. A question has some twenty, and one that is longer than this is refused anyway."""

TEMPERATURE = 0.8
"""Of every attempt but the first, which takes the likeliest token each time."""

_SAMPLE = 1 << 20
"""Bytes at either end of a file of weights that go into a model's digest."""


class LocalWriter:
    """Any causal language model that transformers loads: safetensors, never code of its own.

    Args:
        model: a checkpoint's folder, or its id on the model hub.
        device, dtype: as for `executive.s3e.backends.loading.load`.

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
        """A reply to each prompt on its own; see `executive.s3e.questions.language_model.Writer`. The same prompt and
        attempt get the same reply, whatever else is asked."""
        try:
            shared = self._shared(system)
        except Exception as error:  # out of memory, say
            return [Reply(error=f"{type(error).__name__}: {error}")] * len(prompts)
        return [self._reply(system, prompt, attempt, *shared) for prompt in prompts]

    def _shared(self, system: str) -> tuple[list[int], Any]:
        """The tokens that every prompt under this system prompt begins with, and what the model keeps of them: a whole
        domain, which is read once."""
        import torch

        one, other = (self._tokens(system, prompt) for prompt in ("on(a)", "in(b)"))
        same = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(one, other, strict=False)))
        beginning = torch.tensor([one[:same]], device=self._device)
        with torch.inference_mode():
            return one[:same], self._model(input_ids=beginning, use_cache=True).past_key_values if same else None

    def _reply(self, system: str, prompt: str, attempt: int, beginning: Sequence[int], kept: Any) -> Reply:
        import torch

        try:
            tokens = self._tokens(system, prompt)
            begins = kept is not None and len(tokens) > len(beginning) and tokens[: len(beginning)] == beginning
            ids = torch.tensor([tokens], device=self._device)
            with torch.random.fork_rng(), torch.inference_mode():
                torch.manual_seed(int.from_bytes(hashlib.sha256(f"{attempt} {prompt}".encode()).digest()[:8], "big"))
                drawn = {"do_sample": True, "temperature": TEMPERATURE} if attempt else {"do_sample": False}
                written = self._model.generate(
                    input_ids=ids,
                    attention_mask=torch.ones_like(ids),
                    past_key_values=deepcopy(kept) if begins else None,
                    max_new_tokens=MOST_TOKENS,
                    pad_token_id=self._tokenizer.eos_token_id,
                    **drawn,
                )
            return Reply(self._tokenizer.decode(written[0, len(tokens) :], skip_special_tokens=True))
        except Exception as error:  # the other prompts may do better
            return Reply(error=f"{type(error).__name__}: {error}")

    def _tokens(self, system: str, prompt: str) -> list[int]:
        return list(self._tokenizer(self._render(system, prompt), add_special_tokens=False)["input_ids"])

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
