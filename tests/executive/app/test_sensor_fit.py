"""What is learned of an eye from labelled looks is what it is; the file keeps it; a run is put together from it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from executive.app import monitors
from executive.app.config import EstimatorConfig, MonitorConfig
from executive.app.monitors import open_monitor
from executive.app.sensor_fit import fit, load, load_outcomes, save
from executive.belief import (
    EXACT,
    ActionModel,
    BayesMonitor,
    Chances,
    Group,
    MutexNetwork,
    SensorModel,
    ThresholdMonitor,
    Thresholds,
)
from executive.belief.conformal import covered
from executive.cli import BAD_INPUT, exit_code
from executive.domain.loader import load_domain
from executive.errors import DomainError, InputError
from executive.planning.mutex_groups import Mutexes
from executive.s3e.calibration import Calibration, Scaling
from executive.s3e.calibration_file import FILE, FORMER, Document, read, write
from executive.types import Atom, Belief, SkillStatus
from tests.executive.belief.hands import ATOMS, FLOOR, HAND, NETWORK, PLACES, THINGS, truth
from tests.executive.sim.stage import ROOT
from tests.fakes import FREE

TRAY = ROOT / "tests" / "domains" / "tray"
Looks = list[tuple[Mapping[Atom, float], Mapping[Atom, bool]]]


def room(rng: np.random.Generator) -> Mapping[Atom, bool]:
    where = {thing: str(rng.choice([*PLACES, FLOOR])) for thing in THINGS}
    return truth({**where, str(rng.choice(THINGS)): HAND} if rng.random() < 0.5 else where)


def flipping(count: int, seed: int, misses: float, false_alarms: float) -> Looks:
    """Plain answers, each wrong with a chance that hangs on what is so."""
    rng = np.random.default_rng(seed)
    looks: Looks = []
    for _ in range(count):
        facts = room(rng)
        wrong = {atom: rng.random() < (misses if value else false_alarms) for atom, value in facts.items()}
        looks.append(({atom: float(value != wrong[atom]) for atom, value in facts.items()}, facts))
    return looks


def exaggerating(count: int, seed: int, factor: float) -> Looks:
    """Graded answers whose log-odds are those of a well-calibrated eye times `factor`."""
    rng = np.random.default_rng(seed)
    looks: Looks = []
    for _ in range(count):
        facts = room(rng)
        odds = {atom: factor * 2.0 * rng.normal(1.0 if value else -1.0, 1.0) for atom, value in facts.items()}
        looks.append(({atom: 1 / (1 + math.exp(-value)) for atom, value in odds.items()}, facts))
    return looks


def test_rates_of_plain_answers_are_found_again() -> None:
    trust = fit(flipping(1600, 1, misses=0.15, false_alarms=0.03), NETWORK)
    assert trust.looks == 1600
    reading = trust.sensor_model.error_models["at"]
    assert reading.misses == pytest.approx(0.15, abs=0.03)
    assert reading.false_alarms == pytest.approx(0.03, abs=0.01)
    assert reading.evidence(1.0) == pytest.approx(math.log(0.85 / 0.03), abs=0.3)
    assert reading.evidence(0.0) == pytest.approx(math.log(0.15 / 0.97), abs=0.3)


@pytest.mark.parametrize("factor", [0.5, 1.0, 3.0])
def test_exaggeration_is_taken_out_and_so_is_how_often_atoms_were_true(factor: float) -> None:
    reading = fit(exaggerating(1600, 2, factor), NETWORK).sensor_model.error_models["at"]
    for odds in (-0.8, -0.3, 0.3, 0.8):  # of truth against falsehood: four times the answer's distance from the middle
        answer = 1 / (1 + math.exp(-factor * 2.0 * odds))
        assert reading.evidence(answer) == pytest.approx(2.0 * odds, abs=0.25)


def test_thresholds_cover_looks_as_a_run_judges_them() -> None:
    trust = fit(exaggerating(1000, 3, 1.0), NETWORK)
    monitor = BayesMonitor(NETWORK, trust.sensor_model, actions=None)
    judged = [
        (monitor.looked(monitor.begin(), Belief(0, said), 0)[1].belief.probability, facts)
        for said, facts in exaggerating(1000, 4, 1.0)
    ]
    for alpha in (0.1, 0.2):
        for share in covered(trust.conformal, alpha, judged).values():
            assert share == pytest.approx(1 - alpha, abs=0.04)


def test_an_eye_that_says_nothing_is_worth_nothing() -> None:
    of_free = [(said, {FREE: True}) for said, facts in flipping(60, 5, 0.5, 0.5) if facts[FREE]]
    for looks in (flipping(400, 5, 0.5, 0.5), flipping(400, 6, 0.9, 0.9), of_free):
        for reading in fit(looks, NETWORK).sensor_model.error_models.values():
            assert abs(reading.evidence(1.0)) < 0.4
            assert abs(reading.evidence(0.0)) < 0.4


def test_there_must_be_something_to_learn_from() -> None:
    with pytest.raises(InputError, match="fewer than two looks"):
        fit([({}, {}), ({ATOMS[0]: 0.5}, {ATOMS[0]: True})], NETWORK)


def test_a_file_keeps_what_was_learned_domain_by_domain(tmp_path: Path) -> None:
    one, other = (fit(flipping(60, seed, 0.1, 0.05), NETWORK) for seed in (7, 8))
    assert save(tmp_path, "grocery", one) == tmp_path / FILE
    save(tmp_path, "tray", other)
    save(tmp_path, "grocery", other)
    for domain, saved in (("grocery", other), ("tray", other)):
        again = load(tmp_path, domain)
        assert again.sensor_model == saved.sensor_model
        assert again.looks == 60
        for name, scores in saved.conformal.scores.items():
            assert again.conformal.scores[name] == pytest.approx(scores, abs=1e-8)
    with pytest.raises(InputError, match="did you mean 'tray'") as caught:
        load(tmp_path / FILE, "trai")
    assert (caught.value.file, caught.value.key) == (tmp_path / FILE, "domains")


GOOD = {
    "format": 2,
    "domains": {
        "d": {
            "looks": 2,
            "correlation_within": 0.2,
            "predicates": {"on": {"false_alarms": 0.1, "misses": 0.1, "slope": 1.0, "bias": 0.0, "scores": [0.1]}},
            "atoms": {"on(a)": {"false_alarms": 0.2, "misses": 0.2, "slope": 1.0, "bias": 0.0}},
        }
    },
}


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ('"format": 2', '"format": 3', "format"),
        ('"looks": 2', '"looks": "two"', "domains.d.looks"),
        ('"misses": 0.1', '"misses": 1.5', "domains.d.predicates.on"),
        ('"misses": 0.2', '"misses": 1.5', "domains.d.atoms.on(a)"),
        ('"on(a)"', '"on(a"', "domains.d.atoms.on(a"),
        ('"correlation_within": 0.2', '"correlation_within": 2', "domains.d.correlation_within"),
        ('"scores": [0.1]', '"scores": [7.0]', "domains.d.predicates.on"),
        ('"format"', '"fromat"', "format"),
        ("{", "", None),
    ],
)
def test_a_damaged_file_is_one_line_with_file_and_key(tmp_path: Path, old: str, new: str, key: str | None) -> None:
    file = tmp_path / FILE
    text = json.dumps(GOOD)
    file.write_text(text)
    assert load(file, "d").looks == 2
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        load(file, "d")
    assert (caught.value.file, caught.value.key) == (file, key)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_or_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no such file"):
        load(tmp_path / "none.json", "d")
    (tmp_path / "in-the-way").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        save(tmp_path / "in-the-way" / FILE, "d", fit(flipping(10, 1, 0.1, 0.1), NETWORK))


def test_one_file_has_the_error_rates_and_the_correction(tmp_path: Path) -> None:
    fitted, correction = fit(flipping(60, 7, 0.1, 0.05), NETWORK), Calibration(Scaling(2.0, 1.0))
    file = save(tmp_path, "grocery", fitted, correction, model="m", runtime="transformers", quantisation="float32")
    assert [path.name for path in tmp_path.iterdir()] == [FILE]
    assert load(file, "grocery").sensor_model == fitted.sensor_model
    assert Calibration.load(file).shared == correction.shared
    other = Calibration(Scaling(3.0, 0.0), model="m")
    other.save(tmp_path)
    assert load(file, "grocery").looks == 60, "what else the file has stays"
    assert Calibration.load(tmp_path) == other
    with pytest.raises(InputError, match="'transformers' there and 'server' here") as caught:
        save(tmp_path, "tray", fitted, runtime="server")
    assert caught.value.key == "runtime"


def test_measured_correlations_are_those_of_the_sensor_model(tmp_path: Path) -> None:
    fitted = fit(flipping(60, 7, 0.1, 0.05), NETWORK, {"at": {"again": 0.6, "cameras": 0.25}})
    again = load(save(tmp_path, "grocery", fitted), "grocery")
    assert again.sensor_model.correlations == fitted.sensor_model.correlations == {"at": 0.6}
    assert again.repeats == {"at": {"again": 0.6, "cameras": 0.25}}


def test_the_two_files_of_version_0_1_are_read_together(tmp_path: Path) -> None:
    scaling = {"slope": 1.5, "bias": -0.5, "true": 3, "false": 4}
    correction = {"format": 1, "model": "m", "method": "platt", "shared": scaling, "predicates": {"on": scaling}}
    rates = {"false_alarms": 0.1, "misses": 0.2, "slope": 1.0, "bias": 0.0}
    domain = {"looks": 2, "alike": 0.3, "lasting": 0.4, "predicates": {"on": {**rates, "scores": [0.1]}}}
    (tmp_path / FILE).write_text(json.dumps(correction))
    (tmp_path / FORMER).write_text(json.dumps({"format": 1, "domains": {"d": domain}}))
    with pytest.warns(FutureWarning, match=r"until version 0\.3"):
        document = read(tmp_path)
    write(tmp_path, document)
    (tmp_path / FORMER).unlink()
    known = load(tmp_path, "d")
    assert (known.sensor_model.correlation_within, known.sensor_model.correlation_across) == (0.3, 0.4)
    assert known.sensor_model.error_models["on"].misses == 0.2
    assert Calibration.load(tmp_path).predicates["on"] == Scaling(1.5, -0.5, 3, 4)
    (tmp_path / FILE).unlink()
    (tmp_path / FORMER).write_text(json.dumps({"format": 1, "domains": {"d": domain}}))
    with pytest.warns(FutureWarning):
        assert load(tmp_path, "d").looks == 2
    assert read(write(tmp_path / "empty.json", Document())) == Document()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[pik]\ndone = [1, 0, 0]", "pik: there is no action 'pik'; did you mean 'pick'"),
        ("[pick]\ndon = [1, 0, 0]", "pick.don: no skill reports 'don'; did you mean 'done'"),
        ("[pick]\ndone = [1, 0]", "pick.done: expected three counts"),
        ("[pick]\ndone = [1, 0, -1]", "pick.done: expected three counts"),
        ("[pick]\ndone = [1, 0, true]", "pick.done: expected three counts"),
        ("pick = 3", "pick: expected a table"),
        ("[pick", "is not TOML"),
    ],
)
def test_a_mistake_in_a_domains_outcomes_is_named(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "outcomes.toml"
    file.write_text(text)
    with pytest.raises(DomainError) as caught:
        load_outcomes(file, ["pick", "place"])
    assert words in str(caught.value)
    assert str(file) in str(caught.value)


def test_the_grocery_skills_were_measured() -> None:
    domain = load_domain("grocery")
    assert domain.outcomes in domain.files
    assert domain.outcomes is not None
    counts = load_outcomes(domain.outcomes, domain.parsed.actions)
    for action in ("pick", "place"):
        chances = ActionModel(counts).chances(action, SkillStatus.DONE)
        assert chances.effects > 0.99
        assert counts[action, SkillStatus.DONE] > Chances(500, 0, 0)


GROUPS = (Group((Atom("hand-free"), Atom("holding", ("red-cube",)))),)


@pytest.fixture
def no_translator(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(monitors, "find_mutexes", lambda schema, **_: Mutexes(GROUPS, frozenset()))


@pytest.fixture
def model(tmp_path: Path) -> EstimatorConfig:
    """A model's folder with a calibration file beside the weights, for the tray."""
    domain = load_domain(TRAY)
    rng = np.random.default_rng(1)
    looks: Looks = []
    for _ in range(80):
        facts = {atom: bool(rng.random() < 0.3) for atom in domain.task.atoms}
        looks.append(({atom: min(1.0, abs(value - rng.random() * 0.6)) for atom, value in facts.items()}, facts))
    save(tmp_path, "tray", fit(looks, MutexNetwork(domain.task.atoms)))
    return EstimatorConfig(vlm=str(tmp_path))


@pytest.mark.usefixtures("no_translator")
def test_a_monitor_is_put_together_from_a_few_words(model: EstimatorConfig) -> None:
    domain = load_domain(TRAY)
    known = load(Path(str(model.vlm)), "tray")
    atoms = tuple(sorted(domain.task.atoms))

    def opened(config: MonitorConfig, eye: EstimatorConfig | None) -> BayesMonitor:
        monitor = open_monitor(config, domain, eye)
        assert isinstance(monitor, BayesMonitor)
        assert monitor.network.atoms == atoms
        assert monitor.network.groups == GROUPS
        return monitor

    always_right = opened(MonitorConfig(), None)
    assert always_right.sensor_model == EXACT
    assert always_right.actions == ActionModel()
    assert opened(MonitorConfig(memory=False), None).actions is None
    unknown = opened(MonitorConfig(), EstimatorConfig(vlm="somewhere/else"))
    assert unknown.sensor_model == SensorModel()
    assert not unknown.thresholds
    measured = opened(MonitorConfig(), model)
    assert measured.sensor_model == known.sensor_model
    assert not measured.thresholds
    asked = opened(MonitorConfig(alpha=0.1), model)
    assert asked.thresholds == known.conformal.thresholds(0.1)
    elsewhere = opened(
        MonitorConfig(alpha=0.2), EstimatorConfig(server="http://h/v1", calibration=Path(str(model.vlm)) / FILE)
    )
    assert elsewhere.thresholds == known.conformal.thresholds(0.2)
    with pytest.warns(FutureWarning, match="trust is called calibration now"):
        former = MonitorConfig(alpha=0.2, trust=Path(str(model.vlm)) / FILE)
    assert opened(former, EstimatorConfig(server="http://h/v1")).thresholds == elsewhere.thresholds
    of_oracle = open_monitor(MonitorConfig(), domain, None, calibration=Path(str(model.vlm)))
    assert isinstance(of_oracle, BayesMonitor)
    assert of_oracle.sensor_model == known.sensor_model
    plain = open_monitor(MonitorConfig(threshold=0.3), domain, model)
    assert plain == ThresholdMonitor(domain.task.atoms, Thresholds(0.3, 0.3))


@pytest.mark.usefixtures("no_translator")
@pytest.mark.parametrize(
    ("config", "looking", "file", "key"),
    [
        ({"alpha": 0.1}, "oracle", None, "alpha"),
        ({"alpha": 0.1}, "elsewhere", None, "alpha"),
        ({"alpha": 0.001}, "model", FILE, "alpha"),
        ({}, "none.json", "none.json", None),
    ],
)
def test_what_does_not_go_together_is_said_in_one_line(
    model: EstimatorConfig, config: dict[str, object], looking: str, file: str | None, key: str | None
) -> None:
    eye = {
        "oracle": None,
        "elsewhere": EstimatorConfig(vlm="somewhere/else"),
        "model": model,
        "none.json": EstimatorConfig(calibration=Path("none.json")),
    }[looking]
    with pytest.raises(InputError) as caught:
        open_monitor(MonitorConfig(**config), load_domain(TRAY), eye)  # type: ignore[arg-type]
    where = caught.value.file
    assert (None if where is None else Path(where).name, caught.value.key) == (file, key)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "values",
    [{"alpha": 0.0}, {"alpha": 1.0}, {"threshold": -0.1}, {"threshold": 1.1}, {"alpha": 0.1, "threshold": 0.5},
     {"threshold": 0.5, "trust": Path("t.json")}],
)  # fmt: skip
def test_a_monitors_configuration_refuses_nonsense(values: dict[str, object]) -> None:
    with pytest.raises(InputError):
        MonitorConfig(**values)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "key"),
    [
        (["--estimator", "oracle", "--alpha", "0.1"], "--alpha"),
        (["--alpha", "2"], "--alpha"),
        (["--threshold", "-1"], "--threshold"),
        (["--threshold", "0.5", "--alpha", "0.1"], "--alpha"),
    ],
)
def test_options_that_do_not_fit_are_one_line_and_leave_nothing_behind(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], key: str
) -> None:
    assert exit_code(["run", "grocery", "--runs", str(tmp_path / "runs"), *options]) == BAD_INPUT
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert key in line
    assert not (tmp_path / "runs").exists()


def test_thresholds_hold_for_looks_that_alternate() -> None:
    """Picks and places do, and an eye may be better at one of them."""
    chance = np.random.default_rng(5)
    holding = Atom("held", ("a",))

    def looks(number: int) -> Looks:
        sure = [chance.uniform(0.95, 1.0) if index % 2 else chance.uniform(0.6, 1.0) for index in range(number)]
        return [({holding: value}, {holding: True}) for value in sure]

    network = MutexNetwork((holding,), ())
    trust = fit(looks(2000), network)
    monitor = BayesMonitor(network, trust.sensor_model, actions=None)
    new = [
        (monitor.looked(monitor.begin(), Belief(-1, answers), 0)[1].belief.probability, truth)
        for answers, truth in looks(2000)
    ]
    assert covered(trust.conformal, 0.2, new)["held"] == pytest.approx(0.8, abs=0.05)


def test_an_eye_that_does_not_see_one_thing_is_trusted_about_the_others() -> None:
    """Its no to where that one is is worth next to nothing, so that what was known of it stays known."""
    hidden = THINGS[0]
    rng = np.random.default_rng(3)
    looks: Looks = []
    for _ in range(400):
        facts = room(rng)
        said = {atom: 0.98 if true and hidden not in atom.args else 0.02 for atom, true in facts.items()}
        looks.append((said, facts))
    eye = fit(looks, NETWORK).sensor_model
    for atom in ATOMS:
        no = eye.evidence(atom, 0.02)
        assert (abs(no) < 0.5) if hidden in atom.args else (no < -1.5), atom
        if atom.args and hidden not in atom.args:
            assert eye.evidence(atom, 0.98) > 1.5
