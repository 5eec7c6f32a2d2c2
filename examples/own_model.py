"""A model of one's own behind S3E's questions: whatever can say how probable a yes is.

    python -m examples.own_model PICTURE...

This one knows nothing but colours: it says yes where a colour that the question names fills some of a picture.
docs/how-to/own-model.md goes through it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from executive import Belief, Image, load_subject
from executive.s3e import S3E, YES_NO, Answer, AnswerWords, Look, Templates, observe, read_picture

RGB = {"red": (200, 40, 40), "green": (40, 140, 60), "yellow": (230, 210, 60), "white": (245, 245, 245)}


class Glance:
    """Pictures that were taken in: asking again costs nothing but the questions."""

    def __init__(self, images: Sequence[Image], system: str) -> None:
        self.system = system
        self.share = {
            name: max(float((np.abs(image.astype(int) - rgb).max(axis=2) < 60).mean()) for image in images)
            for name, rgb in RGB.items()
        }

    def ask(self, questions: Sequence[str]) -> list[Answer]:
        return [self.answer(question) for question in questions]

    def answer(self, question: str) -> Answer:
        named = [self.share[word] for word in question.lower().rstrip("?").split() if word in self.share]
        prompt = f"{self.system}\n{question}"
        if not named:
            return Answer(prompt, yes_mass=0.0, no_mass=0.0)  # neither yes nor no: unanswered
        yes = min(1.0, 50.0 * max(named))
        return Answer(prompt, yes_mass=yes, no_mass=1.0 - yes)


class Colours:
    """A backend, as a checkpoint or a server is one."""

    name = "colours"

    def look(self, images: Sequence[Image], system: str, words: AnswerWords = YES_NO) -> Look:
        return Glance(images, system)


def judge(pictures: Sequence[str], domain: str = "grocery") -> Belief:
    """What the model believes of every atom of a domain, from picture files."""
    subject = load_subject(domain)
    assert subject.questions is not None
    estimator = S3E(Colours(), Templates.read(subject.questions).translate(subject.task))
    return estimator.estimate(observe({name: read_picture(name) for name in pictures}), subject.task.atoms)


if __name__ == "__main__":
    belief = judge(sys.argv[1:])
    for atom, probability in belief.probability.items():
        print(f"{probability:.2f}  {atom}")
    print(f"{len(belief.unanswered)} unanswered")
