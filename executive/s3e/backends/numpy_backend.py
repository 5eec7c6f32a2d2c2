"""A model that `executive train` has made, without torch: it is ready in half a second, in a fifth of the memory.

`supported` says for which checkpoints that holds; anything else, and every model on a GPU, is for
`executive.s3e.backends.transformers_backend`. The answers are the same to 1e-4.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from executive.errors import InputError
from executive.s3e.backends.answer_tokens import answer_tokens, numeral_tokens
from executive.s3e.backends.chat_template import Chat
from executive.s3e.backends.checkpoint import CONFIG, WEIGHTS, Checkpoint, find, read_object
from executive.s3e.backends.interface import LEAST_MASS, YES_NO, Answer, AnswerWords, Backend, Numerals, Words, rather
from executive.s3e.backends.loading import has_gpu
from executive.s3e.backends.numpy_network import Array, Decoder, KeysAndValues, VisionEncoder
from executive.s3e.backends.prefix_cache import AT_ONCE, Beginning, Suffix, groups
from executive.s3e.backends.transformers_backend import PROBES, Tokens, TransformersBackend, as_pillow, own_mark
from executive.types import Image
from executive.util import threads

log = logging.getLogger(__name__)

_FAMILY: Mapping[str, Mapping[str, Any]] = {
    "": {
        "model_type": "fast_vlm", "projector_hidden_act": "gelu", "vision_feature_layer": -1,
        "vision_feature_select_strategy": "full", "tie_word_embeddings": True, "multimodal_projector_bias": True,
        "dtype": "float32",
    },
    "text_config": {"model_type": "qwen2", "hidden_act": "silu", "use_sliding_window": False},
    "vision_config": {
        "model_type": "resnet", "layer_type": "basic", "hidden_act": "relu", "downsample_in_first_stage": False,
        "num_channels": 3,
    },
}  # fmt: skip
"""What a config has to say, part by part."""

_PICTURES: Mapping[str, Any] = {
    "image_processor_type": "CLIPImageProcessor", "do_resize": True, "do_center_crop": False, "do_rescale": True,
    "do_normalize": True, "resample": 2,
}  # fmt: skip
_PROCESSOR: Mapping[str, Any] = {
    "processor_class": "LlavaProcessor", "num_additional_image_tokens": 0, "vision_feature_select_strategy": "full",
}  # fmt: skip


def open_checkpoint(model: str) -> Backend:
    """Open a checkpoint: without torch where that computes the same, and with transformers elsewhere.

    Raises:
        InputError: there is no such checkpoint, or it is broken.
        MissingError: its family needs a package that is not installed.
    """
    checkpoint = find(model)
    if supported(checkpoint) and not has_gpu():
        try:
            return NumpyBackend(checkpoint)
        except Exception as error:  # whatever readers make of a damaged file; transformers tells it in words
            log.info("%s: not computed with NumPy (%s: %s)", checkpoint.name, type(error).__name__, error)
    return TransformersBackend(model)


def supported(checkpoint: Checkpoint) -> bool:
    """Whether a checkpoint is of the kind that `executive train` makes, in every detail that is computed here."""
    config = read_object(checkpoint.folder / CONFIG, "")
    parts = {name: config if not name else config.get(name, {}) for name in _FAMILY}
    files = ("preprocessor_config.json", "processor_config.json", "tokenizer_config.json", "tokenizer.json")
    if not all((checkpoint.folder / file).is_file() for file in (*files, WEIGHTS, "chat_template.jinja")):
        return False
    shown, processor, tokenizer, _ = (read_object(checkpoint.folder / file, "") for file in files)
    text, size = parts["text_config"], shown.get("size", {})
    return (
        all(_says(parts[name], wanted) for name, wanted in _FAMILY.items())
        and _says(shown, _PICTURES)
        and _says(processor, _PROCESSOR)
        and size.keys() == {"height", "width"}
        and text.get("num_attention_heads") == text.get("num_key_value_heads")
        and text.get("rope_parameters", {}).get("rope_type") == "default"
        and set(text.get("layer_types", ())) == {"full_attention"}
        and "head_dim" not in text
        and tokenizer.get("tokenizer_class") == "TokenizersBackend"
        and "quantization_config" not in config
        and not checkpoint.half
    )


def _says(config: Mapping[str, Any], wanted: Mapping[str, Any]) -> bool:
    return all(config.get(name) == value for name, value in wanted.items())


class NumpyBackend:
    """A checkpoint for which `supported` holds (implements `executive.s3e.backends.interface.Backend`).

    Raises:
        Exception: it is broken.
    """

    runtime, quantisation = "transformers", "float32"
    """Whose answers these are: what is known of a model's mistakes there holds here."""

    def __init__(self, checkpoint: Checkpoint) -> None:
        from safetensors.numpy import load_file
        from threadpoolctl import ThreadpoolController

        folder = checkpoint.folder
        self.name, self._folder = checkpoint.name, folder
        config, shown = read_object(folder / CONFIG, ""), read_object(folder / "preprocessor_config.json", "")
        weights = {name: value.astype(np.float32, copy=False) for name, value in load_file(folder / WEIGHTS).items()}
        self._encoder = VisionEncoder(weights, config["vision_config"], threads.cores())
        self.decoder = Decoder(weights, config["text_config"])
        self.processor = _Processor(folder, config, shown)
        self._blas = ThreadpoolController()  # its threads spin while they wait; pictures are divided among ours
        self._tokens: dict[Words, Tokens] = {}
        self.chat = Chat.with_processor(self.processor)

    def look(self, images: Sequence[Image], system: str, words: AnswerWords = YES_NO) -> NumpyLook:
        """Take in pictures, (H, W, 3) uint8 each, shown together and in order, under a system prompt.

        Raises:
            InputError: there is no picture, or one that the model cannot take; the tokenizer has no token for an
                answer; or the system prompt holds one of its marks.
        """
        return self._look(images, system, words)

    def look_for_numbers(self, images: Sequence[Image], system: str, numerals: Numerals) -> NumpyLook:
        """Take in pictures as `look` does, to ask for numbers about them.

        Raises:
            InputError: as `look`; no number is a token.
        """
        return self._look(images, system, numerals)

    def _look(self, images: Sequence[Image], system: str, words: Words) -> NumpyLook:
        pictures = [self.processor.pixels(picture) for picture in as_pillow(images)]
        mark = self.chat.mark_in(system)
        if mark is not None:
            raise InputError(f"the system prompt holds {own_mark(mark)}")
        tokens = self._answer_tokens(words)
        with self._blas.limit(limits=1, user_api="blas"):
            return NumpyLook(self, self._encoder.tokens(pictures), len(pictures), system, tokens, words)

    def _answer_tokens(self, words: Words) -> Tokens:
        if words not in self._tokens:
            vocabulary, tokenizer = len(self.decoder.embeddings), self.processor.tokenizer
            try:
                if isinstance(words, Numerals):
                    self._tokens[words] = numeral_tokens(tokenizer, words, vocabulary)
                else:
                    found = answer_tokens(tokenizer, words, vocabulary)
                    self._tokens[words] = (found.affirmative, found.negative)
            except InputError as error:
                raise InputError(error.message, file=self._folder) from None
        return self._tokens[words]


class NumpyLook:
    """Pictures that a model has taken in (implements `executive.s3e.backends.interface.Look`)."""

    path = "shared"

    def __init__(
        self, backend: NumpyBackend, seen: Array, pictures: int, system: str, tokens: Tokens, words: Words
    ) -> None:
        self._backend, self._seen, self._pictures, self._system = backend, seen, pictures, system
        self._tokens, self._counts = tokens, isinstance(words, Numerals)
        chat, processor = backend.chat, backend.processor
        one, other = (chat.tokens(self._render(probe)) for probe in PROBES)
        self._beginning = Beginning.between(one, other, processor.expanded(one))
        begun = processor.expanded(one)[: self._beginning.length]
        _, self._past = self._read(begun, None)

    def ask(self, questions: Sequence[str]) -> list[Answer]:
        """One answer per question, in order, none influenced by another."""
        if self._past is None:
            raise ValueError("this look is closed")
        chat, prompts = self._backend.chat, [self._render(question) for question in questions]
        answers: dict[int, Answer] = {}
        suffixes: dict[int, Suffix] = {}
        with self._backend._blas.limit(limits=1, user_api="blas"):
            for index, (prompt, question) in enumerate(zip(prompts, questions, strict=True)):
                if (mark := chat.mark_in(question)) is not None:
                    answers[index] = Answer(prompt, 0.0, 0.0, f"the question holds {own_mark(mark)}")
                elif (suffix := self._beginning.suffix(tokens := chat.tokens(prompt), question)) is not None:
                    suffixes[index] = suffix
                else:
                    hidden, _ = self._read(self._backend.processor.expanded(tokens), None)
                    answers[index] = self._answer(prompt, self._backend.decoder.logits(hidden[-1:])[0])
            indices = iter(suffixes)
            for group in groups(list(suffixes.values()), AT_ONCE):
                for logits in self._row(group):
                    index = next(indices)
                    answers[index] = self._answer(prompts[index], logits)
        return [answers[index] for index in range(len(questions))]

    def close(self) -> None:
        """Free what is kept of the pictures. No question can be asked any more."""
        self._past = None

    def __enter__(self) -> NumpyLook:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _render(self, question: str) -> str:
        return self._backend.chat.render(self._system, self._pictures, question)

    def _read(self, tokens: Sequence[int], past: KeysAndValues | None) -> tuple[Array, KeysAndValues | None]:
        """Run tokens from the first of a prompt on, pictures in their places."""
        ids, decoder = np.array(tokens), self._backend.decoder
        embedded = decoder.embeddings[ids]
        embedded[ids == self._backend.processor.picture] = self._seen
        length = len(ids)
        mask = np.triu(np.full((length, length), -np.inf, dtype=np.float32), 1)
        return decoder.read(embedded, np.arange(length), mask, past)

    def _row(self, group: Sequence[Suffix]) -> Array:
        """The outputs for suffixes that are laid end to end: see `executive.s3e.backends.prefix_cache`."""
        decoder, begun = self._backend.decoder, self._beginning.length
        lengths, shared = (np.array(each) for each in zip(*((len(s.tokens), s.shared) for s in group), strict=True))
        owner, ends = np.repeat(np.arange(len(group)), lengths), lengths.cumsum()
        place = np.arange(len(owner))
        own = (owner[:, None] == owner) & (place[:, None] >= place)
        seen = np.arange(begun) < shared[owner][:, None]
        mask = np.where(np.concatenate([seen, own], axis=1), np.float32(0.0), np.float32(-np.inf))
        positions = shared[owner] + place - (ends - lengths)[owner]
        embedded = decoder.embeddings[[token for suffix in group for token in suffix.tokens]]
        hidden, _ = decoder.read(embedded, positions, mask, self._past)
        return decoder.logits(hidden[ends - 1])

    def _answer(self, prompt: str, logits: Array) -> Answer:
        """The masses of both answers: the softmax over the whole vocabulary, summed over each answer's tokens."""
        wide = logits.astype(np.float64)
        probability = np.exp(wide - wide.max())
        probability /= probability.sum()
        masses = tuple(float(probability[list(ids)].sum()) for ids in self._tokens)
        yes, no = (sum(masses), 0.0) if self._counts else masses
        if not math.isfinite(yes + no):
            return Answer(prompt, 0.0, 0.0, "the model's output is not a number")
        numbers = masses if self._counts else ()
        if yes + no >= LEAST_MASS:
            return Answer(prompt, yes, no, masses=numbers)
        likeliest = int(probability.argmax())
        said = rather(self._backend.processor.tokenizer.decode([likeliest]), float(probability[likeliest]))
        return Answer(prompt, yes, no, said=said, masses=numbers)


class _Tokenizer:
    """The part of a transformers tokenizer that is needed here, over the library that reads its file."""

    bos_token: str | None

    def __init__(self, folder: Path) -> None:
        from tokenizers import Tokenizer

        self._inner: Any = Tokenizer.from_file(str(folder / "tokenizer.json"))
        said = read_object(folder / "tokenizer_config.json", "")
        names = [said.get(f"{name}_token") for name in ("bos", "eos", "unk", "sep", "pad", "cls", "mask")]
        more = said.get("model_specific_special_tokens", {}).values()
        marks = [mark for mark in (*names, *said.get("extra_special_tokens", ()), *more) if isinstance(mark, str)]
        self.bos_token, self.all_special_tokens = said.get("bos_token"), list(dict.fromkeys(marks))
        self.all_special_ids = [self._inner.token_to_id(mark) for mark in self.all_special_tokens]

    def __call__(self, text: str, add_special_tokens: bool = True) -> dict[str, list[int]]:
        return {"input_ids": self.encode(text, add_special_tokens)}

    def encode(self, text: str, add_special_tokens: bool = True) -> list[int]:
        ids: list[int] = self._inner.encode(text, add_special_tokens=add_special_tokens).ids
        return ids

    def decode(
        self, ids: list[int], skip_special_tokens: bool = False, clean_up_tokenization_spaces: bool = False
    ) -> str:
        return str(self._inner.decode(ids, skip_special_tokens=skip_special_tokens))

    def get_vocab(self) -> dict[str, int]:
        vocabulary: dict[str, int] = self._inner.get_vocab()
        return vocabulary


class _Processor:
    """The part of a transformers processor that is needed here."""

    def __init__(self, folder: Path, config: Mapping[str, Any], shown: Mapping[str, Any]) -> None:
        from jinja2.sandbox import ImmutableSandboxedEnvironment

        self.tokenizer = _Tokenizer(folder)
        self.chat_template = (folder / "chat_template.jinja").read_text(encoding="utf-8")
        self.image_token = str(read_object(folder / "processor_config.json", "")["image_token"])
        self.picture, self._tokens = int(config["image_token_index"]), int(config["image_seq_length"])
        self._template = ImmutableSandboxedEnvironment(trim_blocks=True, lstrip_blocks=True).from_string(
            self.chat_template
        )
        self._size = int(shown["size"]["width"]), int(shown["size"]["height"])
        self._factor, mean, deviation = (shown[name] for name in ("rescale_factor", "image_mean", "image_std"))
        self._mean, self._deviation = np.array(mean, dtype=np.float32), np.array(deviation, dtype=np.float32)

    def apply_chat_template(
        self, messages: Sequence[Mapping[str, Any]], add_generation_prompt: bool, tokenize: bool
    ) -> str:
        return self._template.render(messages=messages, add_generation_prompt=add_generation_prompt)

    def expanded(self, tokens: Sequence[int]) -> list[int]:
        """Return a prompt's tokens with as many for each picture as the model takes."""
        return [each for token in tokens for each in [token] * (self._tokens if token == self.picture else 1)]

    def pixels(self, picture: Any) -> Array:
        """Return a picture as the model takes it: (height, width, 3), normalised."""
        from PIL.Image import Resampling

        values = np.asarray(picture.convert("RGB").resize(self._size, Resampling.BILINEAR), dtype=np.float32)
        return (values * np.float32(self._factor) - self._mean) / self._deviation
