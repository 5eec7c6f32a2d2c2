"""Domain folders are read whole, or refused in one line that names the file and the key."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from executive.app.sensor_fit import load_outcomes
from executive.domain.loader import Domain, list_domains, load_domain, load_subject
from executive.errors import DomainError
from executive.lab.evaluation.paraphrases import Paraphrases
from executive.lab.training.wordings import Wordings
from executive.s3e import Templates
from executive.s3e.questions.templates import load_questions
from executive.sim.spec import read_scene
from executive.types import Atom
from executive.util.files import LARGEST

ROOT = Path(__file__).resolve().parents[3]
TRAY = ROOT / "tests" / "domains" / "tray"
SKILLS = ("pick", "place", "home", "aside")
RELATIONS = ("on", "gripping", "gripper-empty")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the smallest domain, to be broken."""
    copy = tmp_path / "tray"
    shutil.copytree(TRAY, copy)
    (copy / "scene.toml").touch()
    (copy / "problems").mkdir()
    shutil.copy(copy / "problem.pddl", copy / "problems" / "fill-tray.pddl")
    return copy


def load(where: str | Path, problem: str | None = None) -> Domain:
    return load_domain(where, problem, skills=SKILLS, relations=RELATIONS)


def said(where: str | Path, problem: str | None = None) -> str:
    """What is said of a broken domain: one printable line, that begins with the file."""
    with pytest.raises(DomainError) as caught:
        load(where, problem)
    message = str(caught.value)
    assert message.isprintable()
    return message.removeprefix(f"{where}/")


def edit(folder: Path, old: str, new: str, file: str = "domain.toml") -> None:
    text = (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new, 1))


def test_the_shipped_domain_is_found_by_name_from_anywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert list_domains() == ("blocksworld", "blocksworld/columns", "cans", "grocery", "kitchen", "tabletop")
    domain = load_domain("grocery")  # with the skills and relations that the installed packages register
    assert (domain.name, domain.world, domain.task.problem) == ("grocery", "mujoco", "sort-all")
    assert domain.skills == {"pick": "pick", "place": "place"}
    assert domain.relations == {
        "on-table": "on",
        "robot-gripping": "gripping",
        "robot-gripper-empty": "gripper-empty",
    }
    assert domain.task is domain.parsed.task
    read = ["domain.toml", "domain.pddl", "problem.pddl", "scene.toml", "questions.toml", "instructions.md"]
    assert [file.name for file in domain.files] == [*read, "outcomes.toml"]
    assert (domain.scene, domain.subject.questions, domain.subject.instructions) == domain.files[3:6]
    assert domain.subject.task is domain.task
    assert domain.subject.pddl == domain.files[1]
    assert domain.looking.moves == ("home", "aside")
    assert domain.looking.closer["robot-gripping"] == ("hand",)
    assert domain.looking.carried == {"pick": ("robot-gripping", (0,)), "place": ("robot-gripping", (0,))}
    assert load("grocery", "one-item").looking == domain.looking, "a problem may do without some of the objects"


def test_problems_are_found_by_name_and_by_path(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert load("grocery", "breakfast").task.problem == "breakfast"
    assert load("grocery", "one-item").task.problem == "one-item"
    for problem in ("fill-tray", "problems/fill-tray.pddl", str(folder / "problems" / "fill-tray.pddl")):
        assert load(folder, problem).files[2].samefile(folder / "problems" / "fill-tray.pddl")
    monkeypatch.chdir(folder.parent)
    assert load("tray", "tray/problems/fill-tray.pddl").task.problem == "fill-tray"
    assert load("tray").folder == Path("tray")


@pytest.mark.parametrize(
    "problem", ["brekfast", "../../etc/passwd", "/etc/passwd", "", "domain.toml", "problems", "a\0b"]
)
def test_a_wrong_problem_is_answered_with_the_right_ones(problem: str) -> None:
    message = said("grocery", problem)
    assert message.endswith("valid: breakfast, one-item")
    assert ("did you mean 'breakfast'?" in message) is (problem == "brekfast")


def test_a_problem_may_be_a_pddl_file_anywhere_that_the_caller_names(folder: Path) -> None:
    outside = folder.parent / "other.pddl"
    text = (folder / "problem.pddl").read_text(encoding="utf-8")
    outside.write_text(text.replace("(problem ", "(problem other-", 1), encoding="utf-8")
    assert load(folder, str(outside)).task.problem.startswith("other-")
    assert "leads outside the domain folder" in said(folder, "../other.pddl"), "this one is looked for in the folder"


def test_a_wrong_domain_is_answered_with_the_right_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert said("grocry") == (
        "grocry: no such folder, nor a shipped domain of that name; did you mean 'grocery'? valid: blocksworld, "
        "blocksworld/columns, cans, grocery, kitchen, tabletop"
    )
    assert "there is no domain.toml in this folder" in said(tmp_path)
    (tmp_path / "file").touch()
    assert "is not a folder" in said(tmp_path / "file")
    (tmp_path / "grocery").mkdir()
    monkeypatch.chdir(tmp_path)
    assert load("grocery").task.name == "grocery"  # a folder of that name without a manifest is no domain


# fmt: off
# What is replaced in domain.toml, by what, and what is said of it.
MISTAKES = {
    "not TOML": ("[world]", "[world", "domain.toml: is not TOML: "),
    "unknown key": ('title = "Two', 'titel = "Two', "line 3: titel: unknown key; did you mean 'title'? valid: "),
    "missing key": ('title = "Two', '# = "Two', "domain.toml: title: is missing"),
    "empty title": ('"Two cubes and a tray"', '""', "line 3: title: should have at least 1 character, got ''"),
    "wrong type": ('"Two cubes and a tray"', "7", "line 3: title: should be a valid string, got 7"),
    "unknown world": ('"mujoco"', '"gazebo"', "line 10: world.kind: should be 'mujoco' or 'symbolic', got 'gazebo'"),
    "missing key of a table": ('scene = "scene.toml"', "", "line 9: world.scene: is missing"),
    "unknown key of a table": ("skill =", "skil =", "line 14: actions.lift.skil: unknown key; did you mean 'skill'?"),
    "missing table": ("[world]", "[word]", "line 9: word: unknown key; did you mean 'world'?"),
    "text for a table": (
        "[actions.lift]\nskill", "[actions]\nlift", "line 14: actions.lift: should be a table, got 'pick'",
    ),
    "unknown action": (
        "[actions.lift]", "[actions.lifd]", "line 13: actions.lifd: there is no action 'lifd' in the PDDL; did you",
    ),
    "forgotten action": (
        '[actions.drop]\nskill = "place"', "", "domain.toml: actions.drop: is missing: name the skill",
    ),
    "unknown skill": (
        '"place"', '"palce"', "line 17: actions.drop.skill: no skill 'palce' is registered; did you mean 'place'?",
    ),
    "unknown predicate": (
        "[predicates.holding]", "[predicates.held]", "line 22: predicates.held: there is no predicate 'held'",
    ),
    "forgotten predicate": (
        '[predicates.holding]\nrelation = "gripping"', "", "predicates.holding: is missing: name the relation",
    ),
    "unknown relation": ('"gripping"', '"griping"', "no relation 'griping' is registered; did you mean 'gripping'?"),
    "no such file": ('"domain.pddl"', '"domian.pddl"', "line 4: domain: 'domian.pddl': there is no such file"),
    "no scene": ('"scene.toml"', '"scenes/one.toml"', "line 11: world.scene: 'scenes/one.toml': there is no such file"),
    "no questions": ('"questions.toml"', '"asked.toml"', "line 6: questions: 'asked.toml': there is no such file"),
    "no instructions": ('"instructions.md"', '"../a.md"', "line 7: instructions: '../a.md' is not a path inside the"),
    "a folder for a file": ('"problem.pddl"', '"problems"', "line 5: problem: 'problems': is not a file"),
    "an empty path": ('"problem.pddl"', '""', "line 5: problem: '': is not a file"),
    "an absolute path": (
        '"domain.pddl"', '"/etc/passwd"', "line 4: domain: '/etc/passwd' is not a path inside the domain folder",
    ),
    "a path upwards": ('"domain.pddl"', '"../tray/domain.pddl"', "is not a path inside the domain folder"),
    "a path upwards, in the middle": (
        '"domain.pddl"', '"problems/../domain.pddl"', "is not a path inside the domain folder",
    ),
    "a path of Windows": ('"domain.pddl"', "'C:\\domain.pddl'", "is not a path inside the domain folder"),
    "a path of Windows upwards": ('"domain.pddl"', "'..\\domain.pddl'", "is not a path inside the domain folder"),
    "a path with a zero byte": ('"domain.pddl"', '"a\\u0000b"', "line 4: domain: 'a\\x00b': cannot be read"),
    "a path without end": ('"domain.pddl"', f'"{"a" * 5000}"', "cannot be read (File name too long)"),
    "a key with a line break": ('title = "Two', '"ti\\ntle" = "Two', "unknown key; did you mean 'title'?"),
    "terminal codes": ('title = "Two', '"\\u001b[31mtitle" = "Two', "unknown key; did you mean 'title'?"),
    "nested without end": ('"Two cubes and a tray"', "[" * 5000, "is not TOML that anyone would write"),
}
# The same for what the manifest of the smallest domain does not say; it is put at the end.
LOOKING = {
    "unknown key of looking": ("[looking]\nmove = []", "looking.move: unknown key; did you mean 'moves'?"),
    "unknown move": ('[looking]\nmoves = ["hom"]', "looking.moves: no skill 'hom' is registered; did you mean 'home'?"),
    "unknown object": (
        '[looking.closer]\ntray-on = ["top"]', "looking.closer.tray-on: there is no predicate and no object 'tray-on'",
    ),
    "a camera for cameras": ('[looking.closer]\nholding = "top"', "should be a valid list, got 'top'"),
}
CARRYING = {
    "holding": "'holding' is not a predicate of the action's parameters, such as holding(?item)",
    "held(?cube)": "there is no predicate 'held'; valid: ",
    "holding()": "holding has 1 parameter, not 0",
    "holding(?cub)": "drop has no parameter ?cub; did you mean '?cube'?",
}
# fmt: on


@pytest.mark.parametrize(("text", "words"), LOOKING.values(), ids=LOOKING)
def test_a_mistake_in_how_to_look_is_named(folder: Path, text: str, words: str) -> None:
    with (folder / "domain.toml").open("a") as file:
        file.write(f"\n{text}\n")
    assert words in said(folder)


@pytest.mark.parametrize(("text", "words"), CARRYING.items(), ids=CARRYING)
def test_a_mistake_in_what_is_carried_is_named(folder: Path, text: str, words: str) -> None:
    edit(folder, 'skill = "place"', f'skill = "place"\ncarrying = "{text}"')
    assert f"line 18: actions.drop.carrying: {words}" in said(folder)


@pytest.mark.parametrize(("old", "new", "words"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_in_the_manifest_is_named(folder: Path, old: str, new: str, words: str) -> None:
    edit(folder, old, new)
    message = said(folder)
    assert message.startswith("domain.toml: ")
    assert words in message


def test_a_mistake_in_the_pddl_is_named(folder: Path) -> None:
    edit(folder, "(holding ?cube - cube)", "(holding ?cube - cub)", "domain.pddl")
    kinds = "bench, cube, object, support, tray"
    assert said(folder) == f"domain.pddl: line 9: unknown type cub; did you mean 'cube'? valid: {kinds}"


def test_what_is_estimated_is_read_from_a_folder_with_a_manifest(folder: Path) -> None:
    subject, domain = load_subject(folder), load(folder)
    assert (subject.name, subject.task.atoms, subject.task.objects) == ("tray", domain.task.atoms, domain.task.objects)
    assert (subject.pddl, subject.questions, subject.instructions) == (domain.files[1], *domain.files[4:])
    assert load_subject("grocery", "one-item").task.problem == "one-item"


def test_what_is_estimated_needs_no_manifest(folder: Path) -> None:
    for name in ("domain.toml", "scene.toml", "instructions.md"):
        (folder / name).unlink()
    subject = load_subject(folder)
    assert subject.task.atoms == load_subject(TRAY).task.atoms
    assert (subject.questions, subject.instructions) == (folder / "questions.toml", None)
    assert load_subject(folder, "fill-tray").task.problem == "fill-tray"
    (folder / "domain.pddl").unlink()
    with pytest.raises(DomainError, match=r"there is no domain\.toml in this folder"):
        load_subject(folder)


def test_what_is_estimated_needs_no_skill_and_no_action_that_could_be_planned_with(folder: Path) -> None:
    edit(folder, ":precondition (holding ?cube)", ":precondition (> (weight ?cube) 0.5)", "domain.pddl")
    edit(folder, "(:action drop", "(:functions (weight ?cube - cube) - number) (:action drop", "domain.pddl")
    edit(folder, "(hand-free)", "(hand-free) (= (weight red-cube) 3)", "problem.pddl")
    edit(folder, 'skill = "pick"', 'skill = "juggle"')
    assert "line 21: 0.5 is not supported: numeric fluents" in said(folder)
    subject = load_subject(folder)
    assert subject.task.numeric == ("weight",)
    assert subject.task.atoms == load_subject(TRAY).task.atoms


@pytest.mark.parametrize("file", ["domain.toml", "domain.pddl", "problem.pddl", "scene.toml"])
def test_a_link_that_leaves_the_folder_is_not_followed(folder: Path, file: str) -> None:
    (folder / file).rename(folder.parent / file)
    (folder / file).symlink_to(folder.parent / file)
    assert "leads outside the domain folder" in said(folder)
    (folder / file).unlink()
    (folder.parent / file).rename(folder / f"real-{file}")
    (folder / file).symlink_to(f"real-{file}")
    assert load(folder).name == "tray"


def test_what_is_no_ordinary_file_is_not_read(folder: Path) -> None:
    (folder / "scene.toml").unlink()
    os.mkfifo(folder / "scene.toml")
    assert "'scene.toml': is not a file" in said(folder)
    (folder / "scene.toml").unlink()
    (folder / "scene.toml").symlink_to("scene.toml")
    assert "'scene.toml': cannot be read" in said(folder)
    (folder / "scene.toml").unlink()
    with (folder / "scene.toml").open("wb") as file:
        file.truncate(LARGEST + 1)
    assert "10,000,001 bytes" in said(folder)
    (folder / "domain.toml").write_bytes(b"title = '\xff'")
    assert "domain.toml: is not UTF-8 text" in said(folder)


def test_loading_runs_nothing_and_loads_no_planner(folder: Path) -> None:
    (folder / "conftest.py").write_text("raise SystemExit('code of a domain folder was run')")
    (folder / "pick.py").write_text("raise SystemExit('code of a domain folder was run')")
    heavy = ("unified_planning", "mujoco", "robosuite", "ompl", "skills")
    script = (
        "import sys\n"
        "from executive.domain.loader import load_domain\n"
        f"load_domain(sys.argv[1], skills={SKILLS!r}, relations={RELATIONS!r})\n"
        f"sys.exit([name for name in {heavy!r} if name in sys.modules] or None)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(folder)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr.strip()) == (0, "")


@given(data=st.data())
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_damage_is_answered_in_one_line_or_does_no_harm(folder: Path, data: st.DataObject) -> None:
    """Cut, doubled and garbled files: a `Domain` or a `DomainError`, never anything else."""
    file = folder / data.draw(st.sampled_from(["domain.toml", "domain.pddl", "problem.pddl"]))
    original = file.read_bytes()
    start, end = sorted(data.draw(st.tuples(*[st.integers(0, len(original))] * 2)))
    pieces = [b"", b"(", b")", b"- ", b"?x", b'"', b"[", b"]]", b"=", b"\0", b"\xff", original[start:end] * 2]
    middle = data.draw(st.sampled_from(pieces))
    file.write_bytes(original[:start] + middle + original[end:])
    try:
        answer = load(folder).name
    except DomainError as error:
        answer = str(error)
    finally:
        file.write_bytes(original)
    assert answer.isprintable()


def shout(folder: Path) -> None:
    """Write every name in a copy of the grocery domain in capital letters."""
    for file in folder.rglob("*.pddl"):
        file.write_text(file.read_text().upper())
    keys = re.compile(r"^([\w-]+)(?= = )", re.MULTILINE)
    for name in ("questions", "outcomes", "wordings", "paraphrases"):
        file = folder / f"{name}.toml"
        text = re.sub(
            r"\{[a-z]+\}", lambda found: found[0].upper(), keys.sub(lambda key: key[1].upper(), file.read_text())
        )
        file.write_text(re.sub(r"^\[(pick|place)\]", lambda found: found[0].upper(), text, flags=re.MULTILINE))
    manifest = (folder / "domain.toml").read_text()
    manifest = re.sub(r"\[(actions|predicates)\.([\w-]+)\]", lambda found: f"[{found[1]}.{found[2].upper()}]", manifest)
    manifest = re.sub(r'"robot-gripping\(.*?"|\["front", "hand"\]', lambda found: found[0].upper(), manifest)
    (folder / "domain.toml").write_text(
        re.sub(r'^(robot-\S+) = \["hand"\]', lambda found: found[0].upper(), manifest, flags=re.MULTILINE)
    )
    scene = (folder / "scene.toml").read_text()
    (folder / "scene.toml").write_text(
        re.sub(r'name = ".*"', lambda found: found[0].replace(found[0][8:-1], found[0][8:-1].upper()), scene)
    )


def test_names_know_no_case_wherever_they_stand(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "domains" / "grocery", folder := tmp_path / "grocery")
    shout(folder)
    for problem in (None, "one-item"):
        loud, quiet = load(folder, problem), load("grocery", problem)
        assert loud.task == quiet.task
        assert (loud.skills, loud.relations, loud.looking) == (quiet.skills, quiet.relations, quiet.looking)
        assert read_scene(loud.scene) == read_scene(quiet.scene)
        assert loud.outcomes
        assert quiet.outcomes
        assert load_outcomes(loud.outcomes, loud.skills) == load_outcomes(quiet.outcomes, quiet.skills)
        texts = [
            load_questions(each.questions, each.task).text for each in (loud.subject, quiet.subject) if each.questions
        ]
        assert texts[0] == texts[1]
        others = [Paraphrases.read(each.folder / "paraphrases.toml", each.task).wordings for each in (loud, quiet)]
        assert others[0] == others[1]
        templates = Templates.read(folder / "questions.toml")
        words = [
            Wordings.of(each.task, templates, each.folder / "wordings.toml", quiet_names(each))
            for each in (loud, quiet)
        ]
        assert words[0] == words[1]


def quiet_names(domain: Domain) -> set[str]:
    """The objects that this problem does without."""
    return set(load("grocery").task.objects) - set(domain.task.objects)


def test_two_keys_that_are_one_name_are_told(folder: Path) -> None:
    edit(folder, '[predicates.hand-free]\nrelation = "gripper-empty"', '[predicates.HOLDING]\nrelation = "gripping"')
    assert "predicates.HOLDING: is there twice" in said(folder)


RELATIONS_SAID = {
    "on(?cube, tray)": "line 20: predicates.resting-on.relation: ?support is missing: resting-on would be the same",
    "on(?cub, ?support)": "predicates.resting-on.relation: resting-on has no parameter ?cub; did you mean '?cube'?",
    "griping(?cube, ?support)": "no relation 'griping' is registered; did you mean 'gripping'?",
}


@pytest.mark.parametrize(("text", "words"), RELATIONS_SAID.items(), ids=RELATIONS_SAID)
def test_a_mistake_in_what_a_relation_is_about_is_named(folder: Path, text: str, words: str) -> None:
    edit(folder, 'relation = "on"', f'relation = "{text}"')
    assert words in said(folder)


def test_a_relation_may_be_told_what_it_is_about(folder: Path) -> None:
    edit(folder, 'relation = "on"', 'relation = "on(?Support,?CUBE)"')
    assert load(folder).relations["resting-on"] == "on(?support, ?cube)"


def test_what_no_action_changes_takes_neither_a_relation_nor_a_question(folder: Path) -> None:
    edit(folder, "(hand-free))", "(hand-free) (fragile ?cube - cube))", "domain.pddl")
    edit(
        folder,
        ":precondition (holding ?cube)",
        ":precondition (and (holding ?cube) (not (fragile ?cube)))",
        "domain.pddl",
    )
    edit(folder, "(hand-free)", "(hand-free) (fragile green-cube)", "problem.pddl")
    domain = load(folder)
    fragile = Atom("fragile", ("green-cube",))
    assert domain.task.static == {fragile}
    assert domain.task.atoms == load_subject(folder).task.atoms == load_subject(TRAY).task.atoms
    with pytest.raises(ValueError):
        domain.parsed.ground("drop", ("green-cube", "tray"))
    with (folder / "domain.toml").open("a") as file:
        file.write('[predicates.fragile]\nrelation = "gripping"\n')
    for task in (load(folder).task, load_subject(folder).task):
        assert fragile in task.atoms, "somebody is to look at it"
        assert not task.static


def test_what_there_is_a_question_for_is_asked_about(folder: Path) -> None:
    edit(folder, "(hand-free))", "(hand-free) (fragile ?cube - cube))", "domain.pddl")
    edit(folder, "[questions]", '[questions]\nFragile = "Is the {cube} fragile?"', "questions.toml")
    (folder / "scene.toml").unlink()
    assert Atom("fragile", ("red-cube",)) in load_subject(folder).task.atoms
    (folder / "scene.toml").touch()
    assert "predicates.fragile: is missing: name the relation" in said(folder)
