"""Whether what a language model wrote asks for an atom: the checks that its replies have to pass.

They are about form alone: what a question means, only another model could tell. But a weak model gives itself away: it
chats, answers, forgets objects or adds some, asks the same thing twice or asks for the opposite.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

from executive.s3e.questions.templates import LONGEST, plain
from executive.types import Atom

_THOUGHTS = re.compile(r"\A\s*<think>.*?</think>", re.DOTALL)
_WORD = re.compile(r"[^\W\d_]+|\d+")
_ENDINGS = ("", "s", "es", "en", "y", "ed")
"""`wood-table` may be called a wooden table, `wool-sock` woolen or woolly."""


def _those(words: str) -> frozenset[str]:
    return frozenset(words.split())


_AUXILIARIES = _those(
    "is are was were am be been do does did has have had can could will would shall should may might must"
)
_OPEN = _those("what which who whom whose where when why how")
_NEGATIONS = _those("not no never without neither nor cannot")
_COMMON = _AUXILIARIES | _OPEN | _NEGATIONS | _those("a an the in on at of to it its this that there and or")
"""Words that are in many a question; an object that is called so (a can) is not named by such a word alone."""
_QUOTES = (('"', '"'), ("'", "'"), ("`", "`"), ("\N{LEFT DOUBLE QUOTATION MARK}", "\N{RIGHT DOUBLE QUOTATION MARK}"))


def tidy(reply: str) -> str:
    """A reply without the blanks and the quotation marks around it, and without what a model thought aloud before."""
    text = _THOUGHTS.sub("", reply).strip()
    for opening, closing in _QUOTES:
        if len(text) > 1 and text.startswith(opening) and text.endswith(closing):
            inner = text[1:-1]
            if opening not in inner and closing not in inner:
                text = inner.strip()
    return text


class Checker:
    """What is wrong with a question, given what the objects of the task are called.

    `names` are descriptive names; an object may also be called by its PDDL name.
    """

    def __init__(self, objects: Iterable[str], names: Mapping[str, str]) -> None:
        self._names = {name: [_words(plain(name)), _words(names.get(name, ""))] for name in objects}
        owners: dict[str, set[str]] = {}
        for name, ways in self._names.items():
            for word in {word for way in ways for word in way}:
                owners.setdefault(word, set()).add(name)
        self._telling = {word for word, having in owners.items() if len(having) == 1 and word not in _COMMON}

    def fault(self, atom: Atom, text: str) -> str:
        """Why `text` is no question for the atom, in words that go on from "it"; empty where it may well be one."""
        words = _words(text)
        if not words:
            return "says nothing"
        if not text.isprintable():
            return "is more than one line"
        if len(text) > LONGEST:
            return f"has {len(text)} characters, and may have {LONGEST}"
        if not text.endswith("?"):
            return "does not end with a question mark"
        if text.count("?") > 1 or re.search(r"[.!:]\s+\w", text):
            return "is more than one sentence"
        meant = {word for name in (atom.predicate, *atom.args) for word in _words(plain(name))}
        negations = [word for word in words if word in _NEGATIONS and word not in meant]
        if negations or re.search(r"n['\N{RIGHT SINGLE QUOTATION MARK}]t\b", text.casefold()):
            return "may ask for the opposite"
        if _OPEN.intersection(words[:1]) or not _AUXILIARIES.intersection(words):
            return "cannot be answered with yes or no"
        for name in dict.fromkeys(atom.args):
            if not self._named(name, words):
                return f"does not name {name}"
        return self._stranger(atom, words)

    def _named(self, name: str, words: Sequence[str]) -> bool:
        """Whether all the words of a name are there, or one that no other object has."""
        ways = self._names.get(name, [_words(plain(name))])
        telling = {word for way in ways for word in way if word in self._telling}
        return any(_has(word, words) for word in telling) or any(
            way and all(_has(word, words) for word in way) for way in ways
        )

    def _stranger(self, atom: Atom, words: Sequence[str]) -> str:
        """Whether an object that has no part in the atom is named in full, word after word, by other than its words."""
        own = set(_words(plain(atom.predicate)))
        own |= {word for name in atom.args for way in self._names.get(name, []) for word in way}
        for name, ways in self._names.items():
            for way in ways if name not in atom.args else []:
                if not own.issuperset(way) and _runs(way, words):
                    return f"names {name}, which the atom has no part in"
        return ""


def _has(word: str, words: Sequence[str]) -> bool:
    return any(word + ending in words for ending in _ENDINGS)


def _runs(way: Sequence[str], words: Sequence[str]) -> bool:
    """Whether the words of `way` follow each other in `words`."""
    spans = (words[start : start + len(way)] for start in range(len(words) - len(way) + 1))
    return any(all(_has(word, [said]) for word, said in zip(way, span, strict=True)) for span in spans)


def _words(text: str) -> list[str]:
    """The words of a text in small letters; letters and digits apart, so that `table1` is table 1."""
    return _WORD.findall(text.casefold())
