"""Questions written as a checkpoint's chat template wants them, and turned into its tokens.

The order is that of Appendix E.2: system prompt, pictures, question. Templates differ in what they take (text as a
string or as parts) and some have no system role; how to speak to this one is found out once, by rendering.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from executive.errors import InputError

Messages = list[dict[str, Any]]
_Style = Callable[[str, int, str, str], Messages]

_SIDE = 224
"""Pixels; no model refuses a picture of this size."""

_SYSTEM, _QUESTION = "Answer as briefly as possible.", "Is anything there?"


def _parts(system: str, pictures: int, question: str, mark: str) -> Messages:
    user = [*({"type": "image"} for _ in range(pictures)), {"type": "text", "text": question}]
    messages = [{"role": "system", "content": [{"type": "text", "text": system}]}, {"role": "user", "content": user}]
    return messages if system else messages[1:]


def _system_as_string(system: str, pictures: int, question: str, mark: str) -> Messages:
    messages = _parts(system, pictures, question, mark)
    return [{"role": "system", "content": system}, *messages[-1:]] if system else messages


def _system_in_question(system: str, pictures: int, question: str, mark: str) -> Messages:
    return _parts("", pictures, f"{system}\n\n{question}" if system else question, mark)


def _strings(system: str, pictures: int, question: str, mark: str) -> Messages:
    messages = [{"role": "system", "content": system}, {"role": "user", "content": f"{mark * pictures}{question}"}]
    return messages if system else messages[1:]


def _one_string(system: str, pictures: int, question: str, mark: str) -> Messages:
    text = f"{system}\n\n{question}" if system else question
    return [{"role": "user", "content": f"{mark * pictures}{text}"}]


_STYLES: tuple[_Style, ...] = (_parts, _system_as_string, _system_in_question, _strings, _one_string)


@dataclass(frozen=True, slots=True)
class Chat:
    """How to write to one checkpoint. Make one with `Chat.with_processor`."""

    processor: Any
    style: _Style
    mark: str
    """What stands for a picture in plain text."""

    @classmethod
    def with_processor(cls, processor: Any) -> Chat:
        """Find out which way of writing the processor's chat template takes.

        Raises:
            InputError: it takes none, or makes nothing of system prompt or question.
        """
        mark = str(getattr(processor, "image_token", "") or "")
        trouble = "it leaves out the system prompt or the question"
        for style in _STYLES:
            chat = cls(processor, style, mark)
            try:
                text = chat.render(_SYSTEM, 1, _QUESTION)
            except Exception as error:  # templates raise what they like
                trouble = f"{type(error).__name__}: {error}"
                continue
            # Parts that a template does not expect come out as Python writes them.
            if _SYSTEM in text and _QUESTION in text and "'type'" not in text and (not mark or _has_mark(text, chat)):
                return chat
        raise InputError(f"its chat template cannot be used ({trouble})")

    def check(self) -> None:
        """Whether the processor takes a question about a picture at all.

        Raises:
            InputError: it does not, whatever the picture.
        """
        from PIL.Image import new

        try:
            self.inputs(self.render(_SYSTEM, 1, _QUESTION), [new("RGB", (_SIDE, _SIDE))])
        except Exception as error:  # each family's has its own way to say so
            name = type(self.processor).__name__
            raise InputError(f"{name} takes no question about a picture ({type(error).__name__}: {error})") from error

    def render(self, system: str, pictures: int, question: str) -> str:
        """The whole prompt as text, up to where the model is to answer."""
        messages = self.style(system, pictures, question, self.mark)
        template = str(getattr(self.processor, "chat_template", None) or self.processor.tokenizer.chat_template)
        # A model that thinks aloud first (Qwen3.5, GLM) would put no probability on an answer yet.
        quick = {"enable_thinking": False} if "enable_thinking" in template else {}
        return str(self.processor.apply_chat_template(messages, add_generation_prompt=True, tokenize=False, **quick))

    def tokens(self, text: str) -> list[int]:
        """A rendered prompt's tokens, a picture being whatever the text says it is (the processor has yet to put in as
        many tokens as the picture takes)."""
        return list(self.processor.tokenizer(text, **self.options(text))["input_ids"])

    def inputs(self, text: str, pictures: list[Any]) -> dict[str, Any]:
        """What the model takes for a rendered prompt with its pictures: tensors of one row."""
        made = self.processor(text=[text], images=[pictures], return_tensors="pt", **self.options(text))
        return {name: value for name, value in made.items() if name != "labels"}  # PaliGemma's, for training

    def options(self, text: str) -> dict[str, Any]:
        """The template has often put the token in already that begins every text; it is not to be there twice."""
        begin = getattr(self.processor.tokenizer, "bos_token", None)
        return {"add_special_tokens": False} if begin and text.startswith(begin) else {}

    def mark_in(self, text: str) -> str | None:
        """One of the tokenizer's own marks that `text` holds. It would be read as that mark: as another picture,
        another turn, the end."""
        marks = [*self.processor.tokenizer.all_special_tokens, self.mark]
        return next((mark for mark in marks if mark and mark in text), None)


def _has_mark(text: str, chat: Chat) -> bool:
    """Whether a picture has left its trace: the text differs from that without one."""
    return text != chat.render(_SYSTEM, 0, _QUESTION)
