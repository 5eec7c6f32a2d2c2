"""What a campaign comes to: metrics from rows, tables that say what they show, and pairs that are pairs."""

from __future__ import annotations

import json
import random
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive import cli
from executive.errors import InputError
from executive.lab.campaign import compare, report
from executive.lab.campaign.campaign_folder import CampaignFolder
from executive.lab.campaign.design import Configuration
from executive.lab.campaign.episode import FAILED, Row
from executive.lab.campaign.intervals import bootstrap, mcnemar, wilson
from executive.lab.campaign.results import METRICS, Results, load_results, results, value
from executive.lab.campaign.scoring import Strike
from executive.lab.campaign.tables import MANY, by_place, heads, markdown, value_of
from executive.lab.common.html import DASH
from tests.executive.lab.campaign.players import FAULTS, Here, campaign, play

METRIC = {metric.name: metric for metric in METRICS}
THREE = (
    Configuration("none", kind="none"),
    Configuration("oracle", kind="oracle"),
    Configuration("hasty", kind="oracle"),
)


def row(seed: int = 0, **changes: Any) -> Row:
    """A row of an episode in which all went well."""
    which = {"domain": "things", "problem": "fake", "faults": "none", "estimator": "oracle", "monitor": ""}
    well = {"outcome": "goal-reached", "command": "executive run things", "goal_seen": True, "goal_true": True}
    counts = {"actions": 4, "looks": 5, "quiet": 4, "sim_seconds": 20.0, "wall_seconds": 1.0}
    return Row(**{**which, **well, **counts, "seed": seed, **changes})


def manifest(seeds: int = 4, configurations: Sequence[str] = ("none", "oracle")) -> dict[str, Any]:
    return {
        "title": "Things <and> places",
        "about": "What it is about.",
        "command": "executive bench things.toml",
        "seeds": list(range(seeds)),
        "episodes": seeds * len(FAULTS) * len(configurations),
        "campaign": {
            "places": {"things/fake": "1234"},
            "faults": {name: list(specs) for name, specs in FAULTS.items()},
            "contenders": {name: {} for name in configurations},
            "options": {},
            "versions": {},
        },
    }


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign that was played: six seeds, three lists of faults, three configurations."""
    out = tmp_path_factory.mktemp("things")
    with CampaignFolder(campaign(6, configurations=THREE), out, "executive bench things.toml") as bench:
        assert bench.play(bench.wanted(), Here())
    return out


def measured(name: str, *rows: Row) -> tuple[float | None, int]:
    said = value(METRIC[name], rows)
    return said.value, said.episodes


def test_success_and_what_only_looks_like_it() -> None:
    rows = (row(0), row(1, goal_true=False), row(2, outcome="partial"), row(3, outcome=FAILED, error="x"))
    assert measured("success", *rows) == (0.25, 4)
    assert measured("false_success", *rows) == (0.25, 4)
    blind = [row(outcome="plan-completed", goal_seen=False, goal_true=true, looks=0) for true in (True, False)]
    assert measured("success", *blind) == (0.5, 2), "one that does not look may claim it, too"
    assert measured("false_success", *blind) == (0.5, 2)


def test_recovery_is_of_the_episodes_that_were_struck() -> None:
    struck = (Strike("drop", "drop@2", 2, 3.0),)
    rows = (row(0), row(1, strikes=struck), row(2, strikes=struck, outcome="gave-up", goal_true=False))
    assert measured("recovery", *rows) == (0.5, 2)
    assert measured("recovery", rows[0]) == (None, 0)
    assert measured("recovery", row(strikes=struck, looks=0)) == (None, 0), "one that does not look cannot recover"


def test_what_one_that_does_not_look_cannot_have_is_said_so() -> None:
    struck = (Strike("drop", "drop@2", 2, 3.0),)
    blind = row(estimator="none", outcome="plan-completed", goal_seen=False, strikes=struck, looks=0, quiet=0)
    looks = row(strikes=struck, quiet=0)
    told = results(manifest(), [replace(blind, faults=name) for name in FAULTS] + [replace(looks, faults="none")])
    cells = {(cell.configuration, cell.faults): cell for cell in told.cells}
    assert value_of(METRIC["recovery"], cells["none", "none"]) == ("n/a", "")
    assert value_of(METRIC["false_alarm"], cells["none", "none"]) == ("n/a", "")
    assert value_of(METRIC["success"], cells["none", "none"]) == ("100", "[21, 100]")
    assert value_of(METRIC["recovery"], cells["oracle", "none"]) == ("100", "[21, 100]")
    assert value_of(METRIC["false_alarm"], cells["oracle", "none"]) == (DASH, "")


def test_alarms_and_misses_are_of_the_episodes_that_could_have_them() -> None:
    rows = (row(0, alarms=2), row(1), row(2, quiet=0), row(3, failed=2, missed=1), row(4, failed=1))
    assert measured("false_alarm", *rows) == (0.25, 4)
    assert measured("missed", *rows) == (0.5, 2)


def test_delays_are_of_what_was_noticed() -> None:
    strikes = (Strike("drop", "d", 1, 3.0, 0.5), Strike("drop", "d", 2, 9.0, 1.5), Strike("shove", "s", 3, 12.0))
    assert measured("delay", row(0, strikes=strikes), row(1, strikes=strikes[2:]), row(2)) == (1.0, 1)


def test_what_could_not_be_played_counts_as_no_success_and_for_nothing_else() -> None:
    failed = row(outcome=FAILED, goal_true=False, quiet=0, sim_seconds=0.0)
    said = {metric.name: metric.of(failed) for metric in METRICS if metric.of(failed) is not None}
    assert said == {"success": 0.0, "false_success": 0.0}


rows = st.builds(
    row,
    outcome=st.sampled_from(["goal-reached", "partial", "gave-up", FAILED]),
    goal_true=st.booleans(),
    alarms=st.integers(0, 2),
    failed=st.integers(0, 2),
    replans=st.integers(0, 9),
    lost=st.sampled_from([(), ("a",)]),
    strikes=st.sampled_from([(), (Strike("drop", "d", 1, 3.0, 0.5),), (Strike("drop", "d", 1, 3.0),)]),
)


@settings(max_examples=40, deadline=None)
@given(st.lists(rows, min_size=1, max_size=12))
def test_a_value_is_a_mean_and_lies_in_its_interval(some: list[Row]) -> None:
    for metric in METRICS:
        told, said = [number for each in some if (number := metric.of(each)) is not None], value(metric, some)
        assert said.episodes == len(told)
        if metric.share:
            assert set(told) <= {0.0, 1.0}
        if told:
            assert said.value == pytest.approx(sum(told) / len(told))
            assert said.interval == (wilson(round(sum(told)), len(told)) if metric.share else bootstrap(told))
        if said.value is not None and said.interval is not None:
            assert said.interval.low - 1e-9 <= said.value <= said.interval.high + 1e-9


def test_cells_are_in_the_order_of_the_file_whatever_the_order_of_the_rows() -> None:
    made = [
        row(seed, faults=faults, estimator=who) for seed in range(4) for faults in FAULTS for who in ("none", "oracle")
    ]
    other = [row(faults="of before"), row(estimator="of before"), row(77), row(problem="of before")]
    shuffled = [*made, *other]
    random.Random(1).shuffle(shuffled)
    cells = results(manifest(), shuffled).cells
    assert [(cell.faults, cell.configuration) for cell in cells] == [
        (faults, who) for faults in FAULTS for who in ("none", "oracle")
    ]
    assert all([each.seed for each in cell.rows] == [0, 1, 2, 3] for cell in cells)


def test_problems_are_shown_together_and_many_of_them_only_so() -> None:
    for count, own in ((1, 1), (2, 2), (MANY + 1, 0)):
        names = [f"p{number}" for number in range(count)]
        rows = [row(seed, problem=name, goal_true=name == "p0") for name in names for seed in range(4)]
        told = {**manifest(configurations=("oracle",)), "episodes": len(rows)}
        told["campaign"] = {**told["campaign"], "places": {f"things/{name}": "1" for name in names}}
        made = results(told, rows)
        shown = by_place(made.cells)
        assert [name in shown for name in ("things/p0", f"all {count} problems")] == [own > 0, count > 1]
        assert len(shown) == own + (count > 1)
        if count > 1:
            (cell,) = shown[f"all {count} problems"]
            assert cell.values["success"].value == pytest.approx(1 / count)
            assert cell.values["success"].episodes == 4 * count
            assert f"all {count} problems" in markdown(made)


def test_a_real_campaign_tells_contenders_apart(folder: Path) -> None:
    found = load_results(folder)
    assert found.configurations == ["none", "oracle", "hasty"]
    assert len(found.rows) == found.manifest["episodes"] == 54
    calm = {cell.configuration: cell.values for cell in found.cells if cell.faults == "none"}
    assert calm["oracle"]["success"].value == calm["none"]["success"].value == 1.0
    assert (calm["oracle"]["false_alarm"].value, calm["none"]["false_alarm"].value) == (0.0, None)
    wild = {cell.configuration: cell.values for cell in found.cells if cell.faults == "drops"}
    assert (wild["oracle"]["success"].value or 0) > (wild["none"]["success"].value or 0)
    assert wild["none"]["delay"].value is None
    assert (wild["none"]["false_success"].value or 0) > 0


def test_the_report_has_everything_and_opens_offline(folder: Path) -> None:
    found = load_results(folder)
    document = report.write(folder, found)
    assert json.loads((folder / report.NUMBERS).read_text()) == document
    assert document["metrics"].keys() == METRIC.keys()
    assert all(said["definition"] and said["interval"] for said in document["metrics"].values())
    assert [cell["episodes"] for cell in document["cells"]] == [6] * 9
    page, text = (folder / report.PAGE).read_text(), (folder / report.TEXT).read_text()
    assert re.findall(r"""(?:src|href)=["'](?!data:)""", page) == []
    assert re.findall(r"<link|<script|<iframe|@import|url\(", page) == []
    assert page.count("data:image/png;base64,") == 2
    for name in ("metrics", "outcomes"):
        assert (folder / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    table = [line for line in text.splitlines() if line.startswith("|")]
    assert len(table) == 2 + 9
    assert {line.count("|") for line in table} == {len(heads()) + 1}
    for metric in METRICS:
        assert metric.definition in text
        assert metric.head in page


def test_what_is_said_in_a_file_is_text_on_the_page_and_missing_episodes_are_told(tmp_path: Path) -> None:
    bad = row(1, goal_true=False, command="executive run <b>")
    broken = row(2, outcome=FAILED, error="<script>", goal_true=False)
    some = results(manifest(), [row(0), bad, broken, row(3, faults="drops", estimator="none")])
    document = report.write(tmp_path, some)
    assert (document["failed"], document["episodes"], document["wanted"]) == (1, 4, 24)
    page = (tmp_path / report.PAGE).read_text()
    assert "<script>" not in page
    assert "&lt;script&gt;" in page
    assert "executive run &lt;b&gt;" in page
    assert "Things &lt;and&gt; places" in page
    assert "20 of 24 episodes are missing." in markdown(some)
    with pytest.raises(InputError, match="has no episodes yet"):
        report.write(tmp_path, Results(manifest(), ()))


def test_a_comparison_pairs_what_met_the_same(folder: Path) -> None:
    ((first, second, pairs),) = compare.compare(f"{folder}:none", f"{folder}:oracle")
    assert (first.name, second.name) == (f"{folder}:none", f"{folder}:oracle")
    assert list(dict.fromkeys(each.condition[2] for each in pairs)) == list(FAULTS)
    episodes = {(e.place.problem, e.faults, str(e.configuration), e.seed): play(e) for e in campaign(6).episodes()}
    for each in pairs:
        of, faults = each.metric.of, each.condition[2]
        told = [
            (a, b)
            for seed in range(6)
            if (a := of(episodes["fake", faults, "none", seed])) is not None
            and (b := of(episodes["fake", faults, "oracle", seed])) is not None
        ]
        assert each.pairs == len(told)
        assert each.difference == bootstrap([b - a for a, b in told])
        assert each.second - each.first == pytest.approx(sum(b - a for a, b in told) / len(told))
        if each.metric.share:
            assert each.only == (sum(a > b for a, b in told), sum(b > a for a, b in told))
            assert each.p == mcnemar(*each.only)
        else:
            assert (each.only, each.p) == (None, None)
    assert not any(each.metric.name == "delay" for each in pairs), "one side says nothing of it"


def test_sides_are_found_or_asked_for(folder: Path, tmp_path: Path) -> None:
    same = compare.compare(str(folder), str(folder))
    assert [first.name.rpartition(":")[2] for first, _, _ in same] == ["none", "oracle", "hasty"]
    assert all(each.first == each.second and each.only in (None, (0, 0)) for _, _, pairs in same for each in pairs)
    alone = tmp_path / "alone"
    with CampaignFolder(campaign(2, configurations=(Configuration("sole", kind="oracle"),)), alone, "bench") as bench:
        bench.play(bench.wanted(), Here())
    ((_, _, pairs),) = compare.compare(str(alone), f"{folder}:oracle")
    assert {each.pairs for each in pairs if each.metric.name == "success"} == {2}
    with pytest.raises(InputError, match=r"compare: .*:sole .*:none"):
        compare.compare(str(alone), str(folder))
    with pytest.raises(InputError, match=r"compare: .*\'oracle\'"):
        compare.compare(f"{folder}:oracel", str(alone))
    with pytest.raises(InputError, match="holds no campaign"):
        compare.compare(str(tmp_path), str(folder))
    elsewhere = tmp_path / "elsewhere"
    far = replace(campaign(1, configurations=(Configuration("oracle", kind="oracle"),)), seeds=(99,))
    with CampaignFolder(far, elsewhere, "bench") as bench:
        bench.play(bench.wanted(), Here())
    with pytest.raises(InputError, match="have no episode in common"):
        compare.compare(str(elsewhere), f"{folder}:oracle")


def test_the_command_line_reports_and_compares(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.exit_code(["bench", "--report", str(folder)]) == cli.REACHED
    out = capsys.readouterr().out
    assert out.startswith("# Things and places\n\n| faults | configuration | episodes | success (%) |")
    assert out.endswith(f"report: {folder / report.PAGE}\n")
    assert cli.exit_code(["bench", "--report", str(folder), "--json"]) == cli.REACHED
    assert json.loads(capsys.readouterr().out)["episodes"] == 54
    both = [f"{folder}:none", f"{folder}:oracle"]
    assert cli.exit_code(["bench", "--compare", *both]) == cli.REACHED
    out = capsys.readouterr().out
    assert out.startswith(f"first: {both[0]}\nsecond: {both[1]}\n\n| faults | metric | pairs |")
    assert "McNemar" in out
    assert cli.exit_code(["bench", "--compare", *both, "--json"]) == cli.REACHED
    assert json.loads(capsys.readouterr().out)["comparisons"][0]["first"] == both[0]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ([], "name a campaign's file, or a folder with --report, or two with --compare"),
        (["x.toml", "--report", "y"], "name a campaign's file, or a folder"),
        (["x.toml", "--engine", "rey"], "--engine: no engine 'rey'; did you mean 'ray'?"),
        (["x.toml", "--address", "auto"], "--address: goes with --engine ray"),
        (["no-such.toml"], "no-such.toml: there is no such file"),
        (["--report", "no-such"], "no-such: holds no campaign"),
    ],
)
def test_what_cannot_be_done_is_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, arguments: list[str], told: str
) -> None:
    monkeypatch.setattr("executive.util.requirements.require", lambda: None)
    assert cli.exit_code(["bench", *arguments]) == cli.BAD_INPUT
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert told in err
