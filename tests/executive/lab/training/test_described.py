"""Training on objects that are described: labels, words, questions, what is held out, and a training to its end."""

from __future__ import annotations

import random
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image as Picture

from executive.app.worlds import checked_stage
from executive.domain.loader import load_domain
from executive.errors import DomainError, InputError, OptionError
from executive.lab.config import TrainConfig
from executive.lab.training import image_shards, tokenizer
from executive.lab.training.described import heads, shards
from executive.lab.training.described.questions import DescribedQuestions
from executive.lab.training.described.space import DescribedSpace, Scenes
from executive.lab.training.described.trainer import DescribedTrainer
from executive.lab.training.described.words import Words
from executive.lab.training.presets import PRESETS
from executive.lab.training.train import Training
from executive.lab.training.wordings import WORDINGS, read_tables
from executive.s3e import Templates
from executive.types import Atom
from tests.executive.lab import described

DOMAIN = load_domain("blocksworld")
SPACE = DescribedSpace.of(DOMAIN, 6)
assert DOMAIN.subject.questions is not None
WORDS = Words.of(SPACE, DOMAIN.task, Templates.read(DOMAIN.subject.questions), DOMAIN.folder / WORDINGS)

Objects = dict[str, dict[str, str]]


@st.composite
def scenes(draw: st.DrawFn) -> tuple[Objects, dict[Atom, bool], Scenes]:
    """A scene of two to six blocks that training may see, with anything true of them."""
    chosen = draw(
        st.lists(st.sampled_from(SPACE.descriptions), min_size=2, max_size=6, unique_by=lambda d: tuple(d.values()))
    )
    objects = {"-".join(each.values()): each for each in chosen}
    names = list(objects)
    flat = [name for name in names if objects[name]["shape"] != "sphere"]
    atoms = [Atom("hand-empty"), *(Atom(p, (name,)) for p in ("on-table", "holding") for name in names)]
    atoms += [Atom("on", (one, other)) for one in names for other in flat if one != other]
    facts = {atom: draw(st.booleans()) for atom in atoms}
    return objects, facts, SPACE.encode(objects, facts)


@given(scenes())
def test_what_can_be_read_off_an_object_is_what_is_true_of_it(made: tuple[Objects, dict[Atom, bool], Scenes]) -> None:
    objects, facts, scene = made
    channels, count = scene.channels()[0], len(SPACE.values)
    for number, (name, own) in enumerate(objects.items()):
        parts = np.split(channels[number], [count, count + 2, 2 * count + 2])
        said = [{SPACE.values[place] for place in np.flatnonzero(part)} for part in (parts[0], parts[2], parts[3])]
        assert said[0] == set(own.values())
        assert parts[1].tolist() == [facts[Atom(p, (name,))] for p in SPACE.unary]
        below = [objects[a.args[1]] for a, true in facts.items() if true and a.predicate == "on" and a.args[0] == name]
        above = [objects[a.args[0]] for a, true in facts.items() if true and a.predicate == "on" and a.args[1] == name]
        assert said[1] == {value for each in below for value in each.values()}
        assert said[2] == {value for each in above for value in each.values()}
    assert not channels[len(objects) :].any()


@given(scenes(), st.integers(0, 2**32))
def test_objects_described_anew_keep_types_and_atoms_and_are_allowed(
    made: tuple[Objects, dict[Atom, bool], Scenes], seed: int
) -> None:
    objects, _, scene = made
    other = SPACE.described_anew(scene, np.random.default_rng(seed))
    assert all((a == b).all() for a, b in zip(scene[1:], other[1:], strict=True))
    found = set()
    for number, own in enumerate(objects.values()):
        words = [SPACE.values[place] for place in np.flatnonzero(other.own[0, number])]
        now = dict(zip(SPACE.attributes, words, strict=True))
        assert now["shape"] == own["shape"]
        assert not SPACE.is_held_out(now)
        found.add(tuple(words))
    assert len(found) == len(objects)


@given(scenes(), st.integers(0, 2**32))
def test_a_name_fits_its_object_alone(made: tuple[Objects, dict[Atom, bool], Scenes], seed: int) -> None:
    objects, _, scene = made
    rng = random.Random(seed)
    value_of = {word: value for value, words in WORDS.values.items() for word in words}
    for number, own in enumerate(objects.values()):
        left, said = WORDS.name(SPACE, scene.own[0], number, rng).split(), set()
        while left:
            longest = next(n for n in range(len(left), 0, -1) if " ".join(left[:n]) in value_of)
            said.add(value_of[" ".join(left[:longest])])
            left = left[longest:]
        assert own["shape"] in said
        assert [each for each in objects.values() if said <= set(each.values())] == [own]


def test_what_is_held_out_is_in_no_description_of_the_training() -> None:
    assert len(SPACE.held_out) == 6
    pairs = {(each["colour"], each["shape"]) for each in SPACE.descriptions}
    assert len(pairs) == 30 - 6
    assert not any(SPACE.is_held_out(each) for each in SPACE.descriptions)
    # Each colour and each shape is seen in other combinations.
    assert {colour for colour, _ in pairs} == set(SPACE.attributes["colour"])


PLAIN = Words.of(SPACE, DOMAIN.task, Templates.read(DOMAIN.subject.questions))
TEXTS = [text for each in PLAIN.patterns.values() for text in each] + list(SPACE.values)
TOKENIZER = tokenizer.make_tokenizer([*TEXTS, *DescribedQuestions.corpus(SPACE)] * 3, 900)
SAMPLER = DescribedQuestions(SPACE, PLAIN, TOKENIZER, [("", 1.0)], 0)
USER = TOKENIZER.convert_tokens_to_ids(tokenizer.USER)


@given(scenes(), st.integers(0, 2**31))
def test_questions_have_true_answers(made: tuple[Objects, dict[Atom, bool], Scenes], seed: int) -> None:
    _, facts, scene = made
    SAMPLER.reseed(seed)
    with patch("executive.lab.training.described.words._SHORT", 0.0):
        batch = SAMPLER.ask(scene, 9, 8, 0.2)
    asked: dict[tuple[int, ...], bool] = {}
    for atom, true in facts.items():
        names = [name.replace("-", " ") for name in atom.args]
        text = PLAIN.question(atom.predicate, names, random.Random(0))
        asked[tuple(TOKENIZER(text, add_special_tokens=False)["input_ids"])] = true
    assert len(asked) == len(facts)
    ids = batch.ids[0].tolist()
    for last, answer, plain in zip(batch.last.tolist(), batch.answers.tolist(), batch.yes_no.tolist(), strict=True):
        before = ids[: last - 9]
        begin = len(before) - before[::-1].index(USER)
        if plain:
            assert answer == (SAMPLER.yes if asked[tuple(before[begin:])] else SAMPLER.no)
    assert batch.known.shape == batch.facets.shape
    assert batch.known.shape[1] == SPACE.size - len(SPACE.values)


@given(scenes(), st.integers(0, 2**31))
def test_a_question_about_two_objects_says_in_what_they_agree(
    made: tuple[Objects, dict[Atom, bool], Scenes], seed: int
) -> None:
    """Of each attribute: whether something that the upper one is on has the value of the lower one."""
    objects, facts, scene = made
    SAMPLER.reseed(seed)
    with patch("executive.lab.training.described.words._SHORT", 0.0):
        batch = SAMPLER.ask(scene, 9, 8, 0.0)
    names = {name.replace("-", " "): name for name in objects}
    for places, agree, answer in zip(batch.questions[0], batch.agree, batch.answers.tolist(), strict=True):
        words = [int(batch.ids[0, place - 9]) for place in places[places >= 0]]
        said = TOKENIZER.decode(words[1:-1]).lower()
        upper, _, lower = said.removeprefix("is the ").removesuffix("?").partition(" on top of the ")
        if not lower:
            assert (agree == -1).all()
            continue
        above = names[upper.strip()]
        below = [a.args[1] for a, true in facts.items() if true and a.predicate == "on" and a.args[0] == above]
        own = objects[names[lower.strip()]]
        assert agree.tolist() == [any(objects[name][key] == own[key] for name in below) for key in own]
        assert answer == SAMPLER.no or agree.all()


def test_an_object_is_asked_about_in_place_of_the_one_that_is_most_like_it() -> None:
    names = ("large-red-metal-cube", "large-blue-metal-cube", "small-green-rubber-cylinder", "small-cyan-rubber-cube")
    objects = {name: dict(zip(SPACE.attributes, name.split("-"), strict=True)) for name in names}
    atoms = [Atom("on", (one, other)) for one in names for other in names if one != other]
    scene = SPACE.encode(objects, {atom: atom == Atom("on", names[0:3:2]) for atom in atoms})
    one = Scenes(*(part[0] for part in scene))
    questions = "executive.lab.training.described.questions"
    alike: list[float] = []
    with patch(f"{questions}._TRUE", 0.0), patch(f"{questions}._NEAR", 1.0), patch(f"{questions}._NULLARY", 0.0):
        for share in (0.0, 1.0):
            with patch(f"{questions}._ALIKE", share):
                drawn = [SAMPLER._drawn(one, SAMPLER._atoms(one))[1].tolist() for _ in range(200)]
            instead = [place[1:] for place in drawn if place[1:] != [2, 0]]  # which is the true one turned around
            alike.append(sum(place == [1, 2] for place in instead) / len(instead))
    assert alike[0] < 0.5 < alike[1] == 1.0


def test_both_names_of_a_question_are_probed() -> None:
    """Each where its name ends, for what is true of its object."""
    chosen = {"-".join(each.values()): each for each in SPACE.descriptions[:40:13]}
    one, other = list(chosen)[:2]
    scene = SPACE.encode(chosen, {Atom("on", (one, other)): True})
    read_off = scene.channels()[0][:, len(SPACE.values) :]
    text = f"Is the {one.replace('-', ' ')} on top of the {other.replace('-', ' ')}?"
    named = [(name.replace("-", " "), number) for number, name in enumerate((one, other))]
    batch = SAMPLER._layout.batch([[SAMPLER._probed(text, named, SAMPLER.yes, True, read_off)]], 0, [])
    ends = [TOKENIZER.decode(batch.ids[0, : place + 1]) for place in batch.probed.tolist()]
    assert [end.strip().endswith(name) for end, (name, _) in zip(ends, named, strict=True)] == [True, True]
    assert batch.known.tolist() == read_off[:2].astype(float).tolist()


def test_the_wordings_that_measure_are_not_those_that_train() -> None:
    for folder in (DOMAIN.folder, DOMAIN.folder / "columns"):
        trained, measured = (read_tables(folder / name)["questions"] for name in (WORDINGS, "paraphrases.toml"))
        assert trained.keys() == measured.keys()
        for name, texts in measured.items():
            assert isinstance(texts, list)
            assert isinstance(trained[name], list)
            assert not {*texts} & {*trained[name]}  # type: ignore[misc]


def test_a_word_for_no_value_is_named(tmp_path: Path) -> None:
    file = tmp_path / WORDINGS
    file.write_text('[values]\nsphre = ["ball"]\n', encoding="utf-8")
    assert DOMAIN.subject.questions is not None
    with pytest.raises(DomainError, match=r"values.sphre.*'sphere'"):
        Words.of(SPACE, DOMAIN.task, Templates.read(DOMAIN.subject.questions), file)


def test_a_collection_with_what_is_held_out_is_refused(tmp_path: Path) -> None:
    data = described.write(tmp_path / "data")
    config = TrainConfig("blocksworld", tmp_path / "out", recipe="smallest", objects="2-4", data=(str(data),), jobs=1)
    with pytest.raises(InputError, match="--combinations seen"):
        Training(config)
    assert not (tmp_path / "out").exists()
    # One that only says so is found out.
    lying = described.write(tmp_path / "lying", combinations="seen")
    job = shards.Collected("blocksworld", (2, 4), (lying,), 64, tmp_path)
    with pytest.raises(InputError, match="large-brown-rubber-cube, which is held out"):
        job(0, lambda done: None)
    assert not list(tmp_path.glob("shard-*"))


def test_data_are_for_domains_whose_objects_change(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="have a problems"):
        Training(TrainConfig("grocery", tmp_path / "out", data=(str(tmp_path),)))


def test_a_training_on_a_collection_runs_to_its_end(tmp_path: Path) -> None:
    data = described.write(tmp_path / "data", described.EPISODES[:1], combinations="seen")
    config = TrainConfig("blocksworld", tmp_path / "out", recipe="smallest", objects="2-4", data=(str(data),), jobs=1)
    model = Training(config).run()
    assert model is not None
    shard = {path.stem for path in (tmp_path / "out" / "pictures" / "shard-0000").iterdir()}
    assert shard == {"pictures", "items", *Scenes._fields}
    pool = shards.DescribedPool(tmp_path / "out" / "pictures")
    states = pool.states()
    assert states.own[:, :2].sum(axis=2).tolist() == [[4, 4]] * 2
    facts = described.facts_of(described.EPISODES[0])
    assert int((states.binary[0] == 1).sum()) == sum(facts[atom] for atom in facts if atom.predicate == "on")


def test_drawn_pictures_show_the_blocks_that_are_said_to_be_there(tmp_path: Path) -> None:
    shards.Drawn("blocksworld", (3, 4), 1, 64, 4, tmp_path)(0, lambda done: None)
    pictures, masks, drawn = shards.DescribedPool(tmp_path).scenes(4, np.random.default_rng(0))
    assert pictures.shape == (4, 1, 64, 64, 3)
    there = drawn.own.any(axis=2).sum(axis=1)
    assert ((there == 3) | (there == 4)).all()
    assert all(set(np.unique(mask)) <= set(range(count + 1)) for mask, count in zip(masks, there, strict=True))
    assert all(len(np.unique(mask)) > 1 for mask in masks)
    values = np.array(SPACE.values)
    for scene in drawn.own:
        for own in scene[scene.any(axis=1)]:
            assert not SPACE.is_held_out(dict(zip(SPACE.attributes, values[own].tolist(), strict=True)))


def test_names_of_several_words_are_looked_up_before_anything_is_learned() -> None:
    """Far more of what the end of a name attends to shows the object that it names than chance would have."""
    trainer = DescribedTrainer(DOMAIN, SPACE, PRESETS["fine"], 0, DOMAIN.folder / WORDINGS)
    decoder, rng = trainer.model.model.language_model, np.random.default_rng(0)
    decoder.set_attn_implementation("eager")
    each = [random.Random(number).sample(SPACE.descriptions, 5) for number in range(6)]
    drawn = [SPACE.encode({"-".join(d.values()): d for d in described}, {}) for described in each]
    scenes = Scenes(*(np.concatenate(parts) for parts in zip(*drawn, strict=True)))
    shown, sampler, luck = heads.synthetic(SPACE, scenes, rng), trainer.sampler, random.Random(0)
    names = [[trainer.words.name(SPACE, own, number, luck) for number in range(5)] for own in scenes.own]
    texts = [[(trainer.words.question("on-table", [name], luck), name) for name in each] for each in names]
    unread = scenes.channels()[0][:, len(SPACE.values) :]
    questions = [
        [sampler._probed(text, [(name, number)], sampler.yes, True, unread) for number, (text, name) in enumerate(each)]
        for each in texts
    ]
    asked = sampler._layout.batch(questions, shown.shape[1], [])
    rows = torch.cat([trainer.codes(shown), decoder.embed_tokens(asked.ids)], 1)
    mask = torch.zeros(asked.mask.shape).masked_fill_(~asked.mask, -1e4)
    with torch.no_grad():
        given = {"inputs_embeds": rows, "attention_mask": mask, "position_ids": asked.positions}
        attention = decoder(**given, use_cache=False, output_attentions=True).attentions[1].mean(1)
    values, cells = len(SPACE.values), shown.shape[1]
    right, share = [], []
    for index, place in enumerate(asked.probed.tolist()):
        row, at = divmod(place, rows.shape[1])
        own = torch.from_numpy(scenes.own[row, index % 5])
        its = ((shown[row, :, :values] > 0) & own).sum(1) == own.sum()
        right.append(float(attention[row, at, :cells][its].sum()))
        share.append(float(its.float().mean()))
    assert len(right) == 30
    assert np.mean(right) > 0.3 > 5 * np.mean(share)


def test_masks_lie_on_what_they_label_wherever_it_is_in_a_picture_that_is_wider_than_high(tmp_path: Path) -> None:
    items = {
        "small-red-rubber-sphere": (0.60, -0.33),
        "small-blue-rubber-cube": (0.60, 0.33),
        "small-green-rubber-cube": (0.45, 0.0),
    }
    blocks = " ".join(f"{name} - {name.rsplit('-', 1)[1]}" for name in items)
    init = " ".join(f"(on-table {name})" for name in items)
    problem = tmp_path / "three.pddl"
    problem.write_text(
        f"(define (problem three) (:domain blocksworld) (:objects {blocks}) (:init (hand-empty) {init})"
        f" (:goal (holding {next(iter(items))})))"
    )
    domain = load_domain("blocksworld", str(problem))
    sampler = image_shards.ImageSampler(domain, [0], 256, start=checked_stage(domain), mask=heads.MASK)
    world, data = sampler._sampler.world, sampler._relighting.data
    for name, (x, y) in items.items():
        world.put(name, np.array([x, y, 0.85, 1.0, 0.0, 0.0, 0.0]))
    with sampler._relighting.set_up(world.data.qpos.copy(), None, {}):
        whole = sampler._relighting.drawing.picture(data, world.spec.cameras[0])
        mask = sampler._items(world.spec.cameras[0])
    sampler.close()
    pixels = np.asarray(Picture.fromarray(whole).resize(mask.shape, Picture.Resampling.BOX)).astype(int)
    for number, channel in enumerate((2, 1, 0), start=1):  # in the order of their names: blue, green, red
        there = pixels[mask == number]
        assert len(there) > 15
        others = [each for each in range(3) if each != channel]
        assert (there[:, channel] > there[:, others].max(axis=1)).mean() > 0.8
