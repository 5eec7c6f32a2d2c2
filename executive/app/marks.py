"""Identical things by marks: their tags in the pictures that a model is shown, and how its prompt speaks of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from executive.domain.loader import Subject
from executive.errors import OptionError
from executive.perception import Localizer, marks
from executive.s3e import S3E, Templates, generic, instruct
from executive.types import Observation


def called(subject: Subject, names: Sequence[str]) -> dict[str, str]:
    """Return what things are called in a subject's questions."""
    templates = Templates.read(subject.questions) if subject.questions is not None else generic(subject.task)
    known = templates.names(subject.task)
    return {name: known[name] for name in names if name in known}


def marker(localizer: Localizer, vlm: S3E, subject: Subject, identical: Sequence[Sequence[str]]) -> Marker:
    """Return what draws tags into pictures, and have the model's prompt say which of the things that look the same has
    which.

    Raises:
        OptionError: no two of the items are alike.
    """
    if not identical:
        raise OptionError("no two of the items are alike, so that there is nothing to tell apart", option="marks")
    lines = []
    for names in identical:
        texts = called(subject, names)
        told = ", ".join(f"{texts[name]} has the tag {tag}" for name, tag in marks.tags(texts).items())
        lines.append(f"Things that look the same have tags in the pictures: {told}.")
    vlm.questions = instruct(vlm.questions, "\n".join(lines))
    return Marker(localizer, subject)


class Marker:
    """Draws tags into pictures, above the things that look the same, where they are estimated to be.

    Args:
        subject: the domain, in whose words things are tagged.
    """

    def __init__(self, localizer: Localizer, subject: Subject) -> None:
        self._localizer = localizer
        self._tags = {n: tag for names in localizer.identical for n, tag in marks.tags(called(subject, names)).items()}

    def __call__(self, taken: Observation) -> Observation:
        poses, known = self._localizer.now().poses, self._localizer.known.cameras
        places = {tag: self._localizer.centre(name, poses[name]) for name, tag in self._tags.items() if name in poses}
        images = {
            name: marks.drawn(image, known[name], taken.depth.get(name), places) if name in known else image
            for name, image in taken.images.items()
        }
        return replace(taken, images=images)
