"""A new domain is whole under every name that is accepted, and nothing is made under any other."""

from __future__ import annotations

import json
import re
import tempfile
import tomllib
from pathlib import Path
from typing import get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import BaseModel

from executive import cli
from executive.domain import loader, manifest, scaffold
from executive.domain.loader import load_domain
from executive.domain.skills import COME_ALONG as SKILLS
from executive.errors import InputError
from executive.relations.kinds import COME_ALONG
from executive.s3e import Templates, load_instructions
from executive.sim import fixtures, part_spec, spec
from executive.sim.spec import read_scene

WORDS_OF_PDDL = ("and", "or", "not", "imply", "exists", "forall", "when", "either", "define", "domain", "problem")

good_names = st.from_regex(r"[a-z][a-z0-9]{0,9}(-[a-z0-9]{1,9}){0,4}", fullmatch=True).filter(
    lambda name: name not in loader.list_domains() and name not in WORDS_OF_PDDL
)


@settings(deadline=None, max_examples=30)
@given(
    good_names | st.sampled_from(["object", "table", "item", "on", "pick-up", "action", "my-domain", "not-my-domain"])
)
def test_every_good_name_gives_a_domain_that_loads(name: str) -> None:
    with tempfile.TemporaryDirectory() as parent:
        made = scaffold.create(name, Path(parent))
        for problem in (None, "one-block"):
            loaded = load_domain(made.folder, problem)
            assert loaded.name == name
            assert loaded.task.name == name
            read_scene(loaded.scene).restricted_to(loaded.task.objects, loaded.scene)
            assert loaded.subject.questions is not None
            assert loaded.subject.instructions is not None
            questions = Templates.read(loaded.subject.questions).translate(loaded.task)
            assert questions.text.keys() == set(loaded.task.atoms)
            assert questions.warnings == ()
            assert load_instructions(loaded.subject.instructions)
        assert sorted(made.files) == sorted(path for path in made.folder.rglob("*") if path.is_file())
        assert name == scaffold.PLACEHOLDER or not any(
            scaffold.PLACEHOLDER in file.read_text() and scaffold.PLACEHOLDER not in name for file in made.files
        )


@settings(deadline=None)
@given(
    st.text(max_size=80).filter(lambda name: not re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", name))
    | st.sampled_from(["", ".", "..", "../x", "/tmp/x", "a/b", "Shelf", "3d", "a_b", "a--b", "-a", "a-", "ä", "a\n"])
    | st.just("a" * (scaffold.LONGEST + 1))
    | st.sampled_from(loader.list_domains())
    | st.sampled_from(WORDS_OF_PDDL)
)
def test_under_another_name_nothing_is_made(name: str) -> None:
    with tempfile.TemporaryDirectory() as parent:
        with pytest.raises(InputError) as raised:
            scaffold.create(name, Path(parent))
        assert str(raised.value).isprintable()
        assert list(Path(parent).iterdir()) == []


@pytest.mark.parametrize(
    ("name", "better"),
    [("Shelf Sorting", "shelf-sorting"), ("my_shelf", "my-shelf"), ("3d", "d"), ("../x", "x"), ("a--b-", "a-b")],
)
def test_a_name_that_is_nearly_one_is_mended(name: str, better: str) -> None:
    assert scaffold.checked(better) == better
    with pytest.raises(InputError, match=f"did you mean '{better}'"):
        scaffold.checked(name)


@pytest.mark.parametrize("there", ["a file", "a folder", "a folder with something in it", "a link to nowhere"])
def test_what_is_there_is_left_as_it_is(there: str, tmp_path: Path) -> None:
    target = tmp_path / "shelf"
    match there:
        case "a file":
            target.write_text("mine")
        case "a link to nowhere":
            target.symlink_to("nowhere")
        case _:
            target.mkdir()
    if there == "a folder with something in it":
        (target / "domain.pddl").write_text("mine")
    before = sorted((path, path.is_file() and path.read_text()) for path in tmp_path.rglob("*"))
    with pytest.raises(InputError, match="is there already"):
        scaffold.create("shelf", tmp_path)
    assert sorted((path, path.is_file() and path.read_text()) for path in tmp_path.rglob("*")) == before


def test_a_folder_that_could_not_be_filled_is_taken_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(source: Path, folder: Path, name: str) -> Path:
        (folder / "half").write_text("written")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(scaffold, "_fill", full)
    with pytest.raises(InputError, match="No space left on device"):
        scaffold.create("shelf", tmp_path)
    assert list(tmp_path.iterdir()) == []


def text(file: str) -> str:
    return (scaffold.TEMPLATE / file).read_text(encoding="utf-8")


def mentions(file: str, key: str) -> bool:
    """Whether the file sets the key or shows in a comment how it is set."""
    pattern = rf"^[#\s]*(\[\[?([\w-]+\.)*)?{re.escape(key)}(\]\]?)?\s*(=|$|#)"
    return re.search(pattern, text(file), flags=re.MULTILINE) is not None


@pytest.mark.parametrize(
    "model",
    [
        spec.SceneSpec,
        spec.RobotSpec,
        spec.TableSpec,
        spec.ItemSpec,
        spec.CameraSpec,
        spec.PlacementSpec,
        spec.RegionSpec,
        fixtures.ContainerSpec,
        fixtures.DrawerSpec,
    ],
)
def test_every_key_of_a_scene_is_shown(model: type[BaseModel]) -> None:
    keys = [field.alias or name for name, field in model.model_fields.items()]
    assert [key for key in keys if not mentions("scene.toml", key)] == []


def test_every_key_of_a_manifest_is_shown() -> None:
    tables = [model for model in vars(manifest).values() if isinstance(model, type) and issubclass(model, BaseModel)]
    keys = {key for model in tables for key in model.model_fields} - {"actions", "predicates"}
    assert {"title", "kind", "skill", "relation"} <= keys
    assert [key for key in sorted(keys) if not mentions("domain.toml", key)] == []
    assert {"actions", "predicates"} <= tomllib.loads(text("domain.toml")).keys()


def test_every_word_that_may_stand_there_is_told() -> None:
    for word in (*SKILLS, *COME_ALONG):
        assert re.search(rf"^#   {word} ", text("domain.toml"), flags=re.MULTILINE), word
    for word in (*spec.ASSETS, *spec.TEXTURES, *get_args(part_spec.Shape), *get_args(part_spec.Material)):
        assert re.search(rf"\b{word}\b", text("scene.toml")), word


def test_defaults_are_told_as_they_are() -> None:
    """What the template sets and calls the default or optional is, where it repeats a default, that default."""
    scene = read_scene(scaffold.TEMPLATE / "scene.toml")
    assert scene.timestep == spec.SceneSpec.model_fields["timestep"].default
    assert scene.placement == spec.PlacementSpec()
    assert scene.robot.speed == spec.RobotSpec.model_fields["speed"].default


def test_the_command_says_what_to_type_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.exit_code(["new", "shelf"]) == 0
    assert "    executive run shelf --estimator oracle\n" in capsys.readouterr().out
    (tmp_path / "deep").mkdir()
    assert cli.exit_code(["new", "shelf", "--in", "deep", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["folder"] == "deep/shelf"
    assert "executive run deep/shelf --estimator oracle" in told["commands"]
    assert all(Path(file).is_file() for file in told["files"])


@pytest.mark.parametrize(("line", "says"), [("new shelf --in nowhere", "--in: nowhere"), ("new Shelf", "'shelf'")])
def test_bad_input_is_one_line(
    line: str, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.exit_code(line.split()) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert says in err
