"""The beginning that all prompts of a look share, pictures included, run through the model once.

What a decoder computes for a token depends on the tokens before it alone. So what it keeps of the beginning is kept,
and each question costs its own tokens only. Many questions go through together, in one of two ways.

Most models keep keys and values of every token. Then the questions are laid end to end in one row: a mask lets each
token see the beginning and the earlier tokens of its own question, and its position is the one that it would have if
its question were the only one. Layers that forget (a sliding window, as in Gemma) or sum up (linear attention, as in
Qwen3.5) cannot be told whom to see; then what is kept is copied, and each question has a row of its own.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import torch

AT_ONCE = 512
"""Question tokens that go through the model together in one row. Fewer waste a machine's parallelism, more waste work
on pairs of questions that must not see each other, and memory for their mask."""

COPIED_AT_ONCE = 16_384
"""Tokens in all rows together, beginnings included, where each question has a row of its own."""


class UnsupportedError(Exception):
    """This model does not keep what a shared beginning needs."""


@dataclass(frozen=True, slots=True)
class Suffix:
    """The rest of a prompt after the first `shared` tokens of the beginning."""

    shared: int
    tokens: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Beginning:
    """What prompts that differ in their question alone have in common, as tokens.

    `text` are the tokens as the tokenizer makes them from the rendered text, where a picture is a single mark or so;
    `length` is how many the model takes for them, where a picture is as many tokens as the processor puts in. After
    the first `pictured` of `text` no picture comes any more, and the two agree one by one. It is `plain` when the last
    token is the same in both, and not one that the processor put there (Gemma's puts newlines after a picture).
    """

    text: tuple[int, ...]
    length: int
    pictured: int
    plain: bool

    @classmethod
    def between(cls, one: Sequence[int], another: Sequence[int], taken: Sequence[int]) -> Beginning:
        """The common beginning of two prompts' tokens, where `taken` is what the model takes for `one`.

        Raises:
            UnsupportedError: they part before the last picture.
        """
        common = _common(one, another)
        alike = _common(one[::-1], taken[::-1])
        if 0 < alike < len(taken) and taken[-alike] == taken[-alike - 1]:
            alike -= 1  # the last of a picture's own tokens, which is its mark in the text, too
        pictured = len(one) - alike
        if common < max(1, pictured):
            raise UnsupportedError("its prompts differ before the last picture")
        length = len(taken) - (len(one) - common)
        return cls(tuple(one[:common]), length, pictured, one[common - 1] == taken[length - 1])

    def suffix(self, prompt: Sequence[int], question: str) -> Suffix | None:
        """What is to be run for a prompt, given its tokens. None when it has to be asked alone.

        A question may change how the end of the beginning is cut into tokens (a newline before it, joined with a
        newline that it starts with). It then shares that much less; prefix and suffix together are always exactly the
        tokens of the whole prompt. What the processor put there cannot be seen in the prompt's own tokens; a letter or
        a digit joins with none of that, and anything else is asked alone.
        """
        if not (self.plain or question[:1].isalnum()):
            return None
        shared = min(_common(self.text, prompt), len(prompt) - 1)
        if shared < self.pictured:
            return None
        return Suffix(self.length - (len(self.text) - shared), tuple(prompt[shared:]))


class Prefix:
    """A beginning inside a model.

    Args:
        model: a transformers decoder that takes pictures.
        inputs: what it takes for a whole prompt: tensors of one row.
        beginning: how much of that is the beginning.

    Raises:
        UnsupportedError: the model keeps nothing.
        Exception: whatever a model raises that does not take what it is given here.
    """

    def __init__(self, model: Any, inputs: Mapping[str, Any], beginning: Beginning) -> None:
        import torch
        from transformers import DynamicCache
        from transformers.cache_utils import DynamicLayer

        whole, length = inputs["input_ids"].shape, beginning.length
        begun = {name: value[:, :length] if _is_row(value, whole) else value for name, value in inputs.items()}
        self._model, self._beginning = model, beginning
        cache = DynamicCache(config=model.config)
        with torch.inference_mode():
            model(**begun, past_key_values=cache, use_cache=True, logits_to_keep=1)
        if cache.get_seq_length() != length:
            raise UnsupportedError("it does not keep what it has read")
        self._cache: Any = cache
        self._start = length + _shift(model)
        self._in_one_row = all(
            type(layer) is DynamicLayer and layer.get_seq_length() == length for layer in cache.layers
        )

    def suffix(self, prompt: Sequence[int], question: str) -> Suffix | None:
        """What is to be run for a prompt, given its tokens. None when it has to be asked alone."""
        suffix = self._beginning.suffix(prompt, question)
        if suffix is not None and not self._in_one_row and suffix.shared < self._beginning.length:
            return None
        return suffix

    def logits(self, suffixes: Sequence[Suffix]) -> Iterator[torch.Tensor]:
        """For each suffix, in order, the model's output after its last token: (V,) float32."""
        if self._in_one_row:
            for group in groups(suffixes, AT_ONCE):
                yield from self._row(group)
            return
        longest = max((len(suffix.tokens) for suffix in suffixes), default=0)
        rows = max(1, COPIED_AT_ONCE // (self._beginning.length + longest))
        for start in range(0, len(suffixes), rows):
            yield from self._rows(suffixes[start : start + rows])

    def _row(self, group: Sequence[Suffix]) -> torch.Tensor:
        """The outputs for suffixes that are laid end to end."""
        import torch

        begun, dtype = self._beginning.length, self._model.dtype
        lengths = torch.tensor([len(suffix.tokens) for suffix in group])
        shared = torch.tensor([suffix.shared for suffix in group])
        owner = torch.repeat_interleave(torch.arange(len(group)), lengths)
        ends = lengths.cumsum(0)
        place = torch.arange(len(owner))
        offset = place - (ends - lengths)[owner]
        own = (owner[:, None] == owner[None, :]) & (place[:, None] >= place[None, :])
        seen = torch.arange(begun)[None, :] < shared[owner][:, None]
        # Added to the scores rather than a boolean, which each layer would have to convert.
        mask = torch.zeros(len(owner), begun + len(owner), dtype=dtype)
        mask.masked_fill_(~torch.cat([seen, own], dim=1), torch.finfo(dtype).min)
        tokens = torch.tensor([[token for suffix in group for token in suffix.tokens]])
        positions = self._start - (begun - shared)[owner] + offset
        try:
            logits = self._forward(self._cache, tokens, mask[None, None], positions[None], ends - 1)
            self._cache.crop(-len(owner))
        except BaseException:
            self._cache = None  # some layers may have taken the questions in, and others not
            raise
        return logits[0]

    def _rows(self, group: Sequence[Suffix]) -> torch.Tensor:
        """The outputs for suffixes in rows of their own, filled up on the right: what comes after a question's last
        token changes nothing before it."""
        import torch

        cache = copy.deepcopy(self._cache)
        cache.reorder_cache(torch.zeros(len(group), dtype=torch.long, device=self._model.device))
        lengths = torch.tensor([len(suffix.tokens) for suffix in group])
        place = torch.arange(int(lengths.max()))
        filled = place[None, :] < lengths[:, None]
        tokens = torch.tensor([[*suffix.tokens, *[0] * (len(place) - len(suffix.tokens))] for suffix in group])
        mask = torch.cat([torch.ones(len(group), self._beginning.length, dtype=torch.long), filled.long()], dim=1)
        ends, which = torch.unique(lengths - 1, return_inverse=True)
        positions = (self._start + place).expand(len(group), -1)
        logits = self._forward(cache, tokens, mask, positions, ends)
        return logits[torch.arange(len(group)), which]

    def _forward(
        self, cache: Any, tokens: torch.Tensor, mask: torch.Tensor, positions: torch.Tensor, keep: torch.Tensor
    ) -> torch.Tensor:
        import torch

        device = self._model.device
        with torch.inference_mode():
            output = self._model(
                input_ids=tokens.to(device),
                attention_mask=mask.to(device),
                position_ids=positions.to(device),
                past_key_values=cache,
                use_cache=True,
                logits_to_keep=keep.to(device),
            )
        logits: torch.Tensor = output.logits.float()
        return logits


def groups(suffixes: Sequence[Suffix], most: int) -> Iterator[Sequence[Suffix]]:
    """Consecutive suffixes of at most `most` tokens together, or a single one that is longer."""
    start, tokens = 0, 0
    for index, suffix in enumerate(suffixes):
        if tokens and tokens + len(suffix.tokens) > most:
            yield suffixes[start:index]
            start, tokens = index, 0
        tokens += len(suffix.tokens)
    if suffixes:
        yield suffixes[start:]


def _shift(model: Any) -> int:
    """How far the position of the token after the beginning is from the number of tokens before it.

    Qwen2-VL and its relatives count a picture's tokens in two dimensions (M-RoPE), so that text goes on from a smaller
    position than its index; their model leaves the difference in `rope_deltas` after each prefill.
    """
    deltas = getattr(getattr(model, "model", None), "rope_deltas", None)
    return 0 if deltas is None else int(deltas.reshape(-1)[0])


def _is_row(value: Any, shape: Any) -> bool:
    """Whether an input says something of each token."""
    return getattr(value, "shape", None) == shape and not value.is_floating_point()


def _common(one: Sequence[int], another: Sequence[int]) -> int:
    """The length of the longest common beginning."""
    return next((i for i, (a, b) in enumerate(zip(one, another, strict=False)) if a != b), min(len(one), len(another)))
