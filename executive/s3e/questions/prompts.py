"""The paper's prompts, word for word as its appendices print them, and what is filled into them.

The line breaks are the paper's; its typeset quotation marks are written as ASCII. Where the appendices show one image
token a line before a question, the model's own chat template puts the images there: that is the backend's part.
"""

from __future__ import annotations

from collections.abc import Mapping

from executive.types import Atom

TRANSLATION = """\
The following is a PDDL domain
{DOMAIN}
Here are the names of all the objects in the current problem, sorted by their type:
{OBJECTS_BY_TYPE}
Given a grounded predicate with concrete variables, write a natural language yes-no query whose answer determines the \
truth value of the predicate.
Respond only with this natural language query and nothing else."""
"""Appendix E.1: the system prompt of the language model that words the questions."""

QUESTION_ANSWERING = """\
A curious human is asking an artificial intelligence assistant yes or no questions.
The assistant answers with one of three responses: YES or NO.
The assistant's response should not include any additional text."""
"""Appendix E.2: the system prompt of the vision-language model. "One of three" is what it says there."""

COUNTING = """\
A curious human is asking an artificial intelligence assistant how many things there are.
The assistant answers with one whole number in digits.
The assistant's response should not include any additional text."""
"""The system prompt of the vision-language model where it is asked for a number (Section 4); the paper prints none."""

NO_TRANSLATION = """\
The following is a PDDL domain
{DOMAIN}
Here are the names of all the objects in the current problem, sorted by their type:
{OBJECTS_BY_TYPE}
Given a grounded predicate with concrete variables, state whether the statement is true or false.
Respond only with a "true" or "false" response and nothing else."""
"""Appendix B: the system prompt of the vision-language model that is shown predicates instead of questions."""

GROCERY_INSTRUCTIONS = """\
The user will show you images of a simulated robot and ask questions about the state of the environment.
The milk carton is a clean white rectangular box with a triangular top.
When the robot is holding the milk carton it looks like there is a white rectangular object being pinched by the \
robot's gripper.
The red can of soda is a small red cylinder.
When the robot is holding the red can of soda it looks like there is a small red object that is enveloped by the \
robot's gripper.
The loaf of bread looks like a small brown box.
When the robot is gripping the loaf of bread it looks like there is a small brown object inside the robot gripper."""
"""Appendix E.3: what Experiment 1 appended to `QUESTION_ANSWERING` to say how its items look. An example: a domain's
own `instructions.md` says how its own items look."""


def translation(domain: str, objects: Mapping[str, str]) -> str:
    """`TRANSLATION` for a domain, given as the text of its PDDL file, and its objects, each with its type."""
    return TRANSLATION.format(DOMAIN=domain.strip(), OBJECTS_BY_TYPE=objects_by_type(objects))


def no_translation(domain: str, objects: Mapping[str, str]) -> str:
    """`NO_TRANSLATION`, filled in like `translation`."""
    return NO_TRANSLATION.format(DOMAIN=domain.strip(), OBJECTS_BY_TYPE=objects_by_type(objects))


def objects_by_type(objects: Mapping[str, str]) -> str:
    """`item type: [lemon,soda-can], table type: [wood-table]` (Appendix E.1), in the order given. Each object is there
    once, under the type that it is declared with."""
    members: dict[str, list[str]] = {}
    for name, kind in objects.items():
        members.setdefault(kind, []).append(name)
    return ", ".join(f"{kind} type: [{','.join(names)}]" for kind, names in members.items())


def query(atom: Atom) -> str:
    """`on-table(lemon,wood-table)`: the user prompt of E.1, and of B in place of a question."""
    return str(atom)


def instructed(system: str, instructions: str) -> str:
    """A system prompt with instructions appended to its end (Appendix E.3)."""
    return "\n".join(filter(None, (system, instructions.strip())))
