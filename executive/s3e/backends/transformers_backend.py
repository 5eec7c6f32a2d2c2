"""A vision-language model in this process: any decoder-style image-text-to-text checkpoint that transformers loads.

Pictures are processed and run through the model once per look; all questions share that
(`executive.s3e.backends.prefix_cache`). Models differ in what they keep and in how they count positions, so nothing is
taken for granted: on the first look of a model, and again when the number of pictures changes, the shared path answers
two questions of our own that are also asked one by one, in full, through the processor. Where the two differ by more
than `TOLERANCE`, or the shared path raises, this model is asked one by one from then on, which is slow and always
right."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from executive.errors import InputError
from executive.s3e.backends.answer_tokens import answer_tokens, numeral_tokens
from executive.s3e.backends.chat_template import Chat
from executive.s3e.backends.checkpoint import find
from executive.s3e.backends.interface import LEAST_MASS, YES_NO, Answer, AnswerWords, Numerals, Words, rather
from executive.s3e.backends.loading import Loaded, load
from executive.s3e.backends.prefix_cache import Beginning, Prefix
from executive.types import Image

if TYPE_CHECKING:
    import torch

Path = Literal["shared", "one by one"]

Tokens: TypeAlias = tuple[tuple[int, ...], ...]
"""The ids whose probabilities are summed for each answer."""

TOLERANCE = {"float32": 1e-4, "bfloat16": 0.1, "float16": 0.03}
"""How far the shared path may be from asking one by one: half the summed difference of the two next-token
distributions (their total variation). In float32 rounding makes about 1e-6, and a position that is off by one 0.03 and
more (tiny random models). In 16 bits rounding alone makes up to 0.05 (bfloat16) or 0.006 (float16; 106 M random
parameters), so that only gross mistakes are seen there: a model of a new kind is best tried in float32 first."""

PROBES = ("Is anything there?", "Are all of these things the same?")
"""What the paths are compared on. They begin differently, so that what they have in common ends before the question."""

log = logging.getLogger(__name__)


class TransformersBackend:
    """A checkpoint, loaded and ready to look (implements `executive.s3e.backends.interface.Backend`).

    Args:
        model: a checkpoint's folder, or its id on the model hub.
        device: "cpu", "cuda", "cuda:1", "mps"; "auto" takes CUDA, else MPS, else the CPU.
        dtype: "float32", "bfloat16", "float16"; "auto" is what the weights are stored in, or float32 on a CPU that
            would have to emulate 16 bits.
        path: how questions are asked; "auto" compares both ways on the first look and takes the faster one that is
            right.

    Raises:
        InputError: there is no such checkpoint, it is broken, or it is no image-text-to-text model.
        MissingError: its family needs a package that is not installed.
    """

    def __init__(
        self,
        model: str | FilePath,
        *,
        device: str = "auto",
        dtype: str = "auto",
        path: Path | Literal["auto"] = "auto",
    ) -> None:
        checkpoint = find(model)
        self._take(load(checkpoint, device, dtype), checkpoint.name, checkpoint.folder, path)

    @classmethod
    def around(
        cls, loaded: Loaded, name: str, folder: FilePath, path: Path | Literal["auto"] = "auto"
    ) -> TransformersBackend:
        """Return a backend of a model that is in memory already; `folder` is where its processor came from.

        Raises:
            InputError: the processor has no chat template that can be used.
        """
        backend = cls.__new__(cls)
        backend._take(loaded, name, folder, path)
        return backend

    def _take(self, loaded: Loaded, name: str, folder: FilePath, path: Path | Literal["auto"]) -> None:
        self._name, self._folder = name, folder
        self.device, self.dtype = loaded.device, loaded.dtype
        self._model, self._processor = loaded.model, loaded.processor
        self._wanted = path
        self._paths: dict[int, Path] = {}  # number of pictures -> how they are asked about
        self._tokens: dict[Words, Tokens] = {}
        try:
            self._chat = Chat.with_processor(self._processor)
            self._chat.check()
        except InputError as error:
            raise InputError(error.message, file=self._folder) from None

    def __repr__(self) -> str:
        return f"TransformersBackend({self._name!r}, device={self.device!r}, dtype={self.dtype!r})"

    @property
    def runtime(self) -> str:
        return "transformers"

    @property
    def quantisation(self) -> str:
        """What the weights are quantised to, or their data type."""
        quantised = getattr(self._model.config, "quantization_config", None)
        return str(getattr(quantised, "quant_method", None) or self.dtype)

    @property
    def name(self) -> str:
        """The checkpoint folder's own name, or the hub's id."""
        return self._name

    def look(self, images: Sequence[Image], system: str, words: AnswerWords = YES_NO) -> TransformersLook:
        """Take in pictures, (H, W, 3) uint8 each, shown together and in order, under a system prompt.

        Raises:
            InputError: there is no picture, or one that the model cannot take; the tokenizer has no token for an
                answer; or the system prompt holds one of its marks.
        """
        return self._look(images, system, words)

    def look_for_numbers(self, images: Sequence[Image], system: str, numerals: Numerals) -> TransformersLook:
        """Take in pictures as `look` does, to ask for numbers about them.

        Raises:
            InputError: as `look`; no number is a token.
        """
        return self._look(images, system, numerals)

    def _look(self, images: Sequence[Image], system: str, words: Words) -> TransformersLook:
        shown = _Shown(self._model, self._chat, self._folder, tuple(as_pillow(images)), system)
        mark = self._chat.mark_in(system)
        if mark is not None:
            raise InputError(f"the system prompt holds {own_mark(mark)}")
        tokens = self._answer_tokens(words)
        return TransformersLook(shown, self._share(shown), tokens, isinstance(words, Numerals))

    def _answer_tokens(self, words: Words) -> Tokens:
        if words not in self._tokens:
            vocabulary = int(self._model.config.get_text_config(decoder=True).vocab_size)
            try:
                tokenizer = self._processor.tokenizer
                if isinstance(words, Numerals):
                    self._tokens[words] = numeral_tokens(tokenizer, words, vocabulary)
                else:
                    found = answer_tokens(tokenizer, words, vocabulary)
                    self._tokens[words] = (found.affirmative, found.negative)
            except InputError as error:
                raise InputError(error.message, file=self._folder) from None
        return self._tokens[words]

    def _share(self, shown: _Shown) -> Prefix | None:
        """What the questions of a look share, or None where they are asked one by one."""
        prompts = [shown.render(probe) for probe in PROBES]
        inputs = shown.inputs(prompts[0])  # in any case: the pictures have to be some that the model can take
        count = len(shown.pictures)
        path = self._paths.get(count, self._wanted)
        if path == "one by one":
            return None
        try:
            taken = inputs["input_ids"][0].tolist()
            begin = Beginning.between(self._chat.tokens(prompts[0]), self._chat.tokens(prompts[1]), taken)
            prefix = Prefix(self._model, inputs, begin)
            if path == "shared":
                return prefix
            difference = self._difference(shown, prefix, prompts)
        except Exception as error:  # whatever it is that a model raises which does not take part
            if self._wanted == "shared":
                raise InputError(f"cannot share what pictures cost ({_line(error)})", file=self._folder) from error
            log.warning("%s: asked one by one, because sharing failed: %s", self.name, _line(error))
            self._paths.setdefault(count, "one by one")  # where it has worked before, it is this look's own trouble
            return None
        allowed = TOLERANCE[self.dtype]
        alike = difference <= allowed  # and not a number is not alike
        self._paths[count] = "shared" if alike else "one by one"
        log.log(
            logging.INFO if alike else logging.WARNING,
            "%s: asked %s, because sharing changes answers about %d picture%s by %.1e (at most %.0e is rounding)",
            *(self.name, self._paths[count], count, "s" * (count > 1), difference, allowed),
        )
        return prefix if alike else None

    def _difference(self, shown: _Shown, prefix: Prefix, prompts: Sequence[str]) -> float:
        """The largest total variation between what both paths make of the next token."""
        pairs = zip(prompts, PROBES, strict=True)
        suffixes = [prefix.suffix(self._chat.tokens(prompt), probe) for prompt, probe in pairs]
        shared = prefix.logits([suffix for suffix in suffixes if suffix is not None])
        return max(
            0.5 * float((together.softmax(-1) - shown.alone(prompt).softmax(-1)).abs().sum())
            for prompt, together in zip(prompts, shared, strict=True)
        )


class TransformersLook:
    """Pictures that a model has taken in (implements `executive.s3e.backends.interface.Look`). What it keeps of them is
    freed with it, or by `close`."""

    def __init__(self, shown: _Shown, prefix: Prefix | None, tokens: Tokens, counts: bool = False) -> None:
        self._shown: _Shown | None = shown
        self._prefix, self._tokens, self._counts = prefix, tokens, counts
        self._decode = shown.chat.processor.tokenizer.decode

    @property
    def path(self) -> Path:
        """How questions are asked."""
        return "one by one" if self._prefix is None else "shared"

    def ask(self, questions: Sequence[str]) -> list[Answer]:
        """One answer per question, in order, none influenced by another. Where the model fails for a question (it runs
        out of memory, its output is not a number), the answer's `error` says so."""
        if self._shown is None:
            raise ValueError("this look is closed")
        prompts = [self._shown.render(question) for question in questions]
        answers: list[Answer | None] = [
            Answer(prompt, 0.0, 0.0, f"the question holds {own_mark(mark)}") if mark is not None else None
            for prompt, mark in zip(prompts, map(self._shown.chat.mark_in, questions), strict=True)
        ]
        waiting = [index for index, answer in enumerate(answers) if answer is None]
        for index, logits in self._together(self._shown.chat, prompts, questions, waiting):
            answers[index] = self._answer(prompts[index], logits)
        return [
            self._alone(self._shown, prompt) if answer is None else answer
            for prompt, answer in zip(prompts, answers, strict=True)
        ]

    def close(self) -> None:
        """Free what is kept of the pictures. No question can be asked any more."""
        self._shown = self._prefix = None

    def __enter__(self) -> TransformersLook:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _together(
        self, chat: Chat, prompts: Sequence[str], questions: Sequence[str], indices: Sequence[int]
    ) -> Iterator[tuple[int, torch.Tensor]]:
        """The outputs after those of the prompts that can share the beginning."""
        if self._prefix is None:
            return
        cut = ((i, self._prefix.suffix(chat.tokens(prompts[i]), questions[i])) for i in indices)
        suffixes = {index: suffix for index, suffix in cut if suffix is not None}
        try:
            yield from zip(suffixes, self._prefix.logits(list(suffixes.values())), strict=True)
        except Exception as error:  # out of memory, as a rule
            log.warning("the rest of this look is asked one by one: %s", _line(error))
            self._prefix = None

    def _alone(self, shown: _Shown, prompt: str) -> Answer:
        try:
            return self._answer(prompt, shown.alone(prompt))
        except Exception as error:  # as above, and nothing is left to try
            return Answer(prompt, 0.0, 0.0, f"the model failed ({_line(error)})")

    def _answer(self, prompt: str, logits: torch.Tensor) -> Answer:
        """The masses of both answers: the softmax over the whole vocabulary, summed over each answer's tokens."""
        wide = logits.cpu().double()
        probability = (wide - wide.logsumexp(0)).exp()
        masses = tuple(float(probability[list(ids)].sum()) for ids in self._tokens)
        yes, no = (sum(masses), 0.0) if self._counts else masses
        if not math.isfinite(yes + no):
            return Answer(prompt, 0.0, 0.0, "the model's output is not a number; try dtype float32")
        numbers = masses if self._counts else ()
        if yes + no >= LEAST_MASS:
            return Answer(prompt, yes, no, masses=numbers)
        likeliest = int(probability.argmax())
        said = rather(self._decode([likeliest]), float(probability[likeliest]))
        return Answer(prompt, yes, no, said=said, masses=numbers)


@dataclass(frozen=True, slots=True)
class _Shown:
    """Pictures and a system prompt, as one model is shown them."""

    model: Any
    chat: Chat
    folder: FilePath
    pictures: tuple[Any, ...]
    system: str

    def render(self, question: str) -> str:
        return self.chat.render(self.system, len(self.pictures), question)

    def inputs(self, prompt: str) -> dict[str, Any]:
        """What the model takes for a whole prompt.

        Raises:
            InputError: the processor does not take these pictures.
        """
        try:
            made = self.chat.inputs(prompt, list(self.pictures))
        except Exception as error:  # each family's processor has its own way to say so
            sizes = ", ".join(f"{picture.width}x{picture.height}" for picture in self.pictures)
            raise InputError(f"cannot take pictures of {sizes} pixels ({_line(error)})", file=self.folder) from error
        device, dtype = self.model.device, self.model.dtype
        return {
            name: value.to(device, dtype if value.is_floating_point() else None) if hasattr(value, "to") else value
            for name, value in made.items()
        }

    def alone(self, prompt: str) -> torch.Tensor:
        """The model's output after a whole prompt, (V,) float32: nothing kept, nothing shared."""
        import torch

        with torch.inference_mode():
            output = self.model(**self.inputs(prompt), use_cache=False, logits_to_keep=1)
        logits: torch.Tensor = output.logits[0, -1].float()
        return logits


def as_pillow(images: Sequence[Image]) -> list[Any]:
    from PIL.Image import fromarray

    if not images:
        raise InputError("there is no picture to look at")
    for index, image in enumerate(images):
        if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
            got = f"{image.shape} {image.dtype}" if isinstance(image, np.ndarray) else type(image).__name__
            raise InputError(f"picture {index + 1} is {got}; wanted (H, W, 3) uint8")
        if image.size == 0:
            raise InputError(f"picture {index + 1} is empty ({image.shape[1]}x{image.shape[0]} pixels)")
    return [fromarray(np.ascontiguousarray(image)) for image in images]


def _line(error: BaseException) -> str:
    """An exception in one line."""
    text = next((line.strip() for line in str(error).splitlines() if line.strip()), "")
    return f"{type(error).__name__}: {text[:300]}"


def own_mark(mark: str) -> str:
    return f"{mark!r}, which the model would not read as text"
