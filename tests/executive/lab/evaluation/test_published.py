"""Published rows are what was published, and ours stand where they belong."""

from __future__ import annotations

from pathlib import Path

import pytest

from executive.errors import DomainError
from executive.lab.evaluation import published
from executive.lab.evaluation.published import HEADS, Published, Row
from executive.types import Atom
from tests.executive.sim.stage import ROOT

GROCERY = published.read(ROOT / "domains" / "grocery")
OURS = {**dict.fromkeys(HEADS, 0.5), "ap_macro": 0.995}


def shipped() -> Published:
    assert GROCERY is not None
    return GROCERY


def names(rows: tuple[Row, ...]) -> list[str]:
    return [row.name for row in rows]


def test_the_papers_tables_are_whole() -> None:
    one, three = shipped().table
    sizes, modified = ("0.5B", "7B", "72B"), ("", " + Instruct", " + Pose", " + Instruct + Pose")
    assert list(one.rows) == [size + more for more in modified for size in sizes]
    assert set(three.rows) == {size + no + more for more in modified for size in sizes for no in ("", " (no trans)")}
    assert one.rows["72B + Instruct + Pose"] == [0.90, 0.94, 0.91, 0.88, 0.91]
    assert three.rows["7B (no trans) + Pose"] == [0.60, 0.64, 0.70, 0.27, 0.59]
    assert shipped().atoms == (Atom("robot-gripping", ("milk-carton",)),)


def test_the_papers_tables_agree_but_for_two_roundings() -> None:
    one, three = (table.rows for table in shipped().table)
    differing = {
        name: [b - a for a, b in zip(one[name], three[name], strict=True)] for name in one if one[name] != three[name]
    }
    assert differing.keys() == {"0.5B + Pose", "0.5B + Instruct + Pose"}
    for difference in differing.values():
        assert difference == pytest.approx([0, 0, 0, 0, 0.01])


def test_the_papers_bold_numbers_are_the_best() -> None:
    table = published.tables(shipped(), {})[0]
    assert table.best == (0.90, 0.94, 0.91, 0.88, 0.91)
    bold = {row.name for row in table.rows if row.values[2] == table.best[2]}
    assert bold == {"72B + Pose", "72B + Instruct + Pose"}


@pytest.mark.parametrize(
    ("name", "first", "third"),
    [
        ("eye + Instruct + Pose", "72B + Instruct + Pose", "72B (no trans) + Instruct + Pose"),
        ("eye + Pose", "72B + Pose", "72B (no trans) + Pose"),
        ("eye", "72B", "72B (no trans)"),
        ("eye (no trans) + Instruct", None, "72B (no trans) + Instruct"),
        ("eye (no trans, lights) + Pose", None, "72B (no trans) + Pose"),
    ],
)
def test_our_row_stands_after_those_that_it_is_like(name: str, first: str | None, third: str) -> None:
    for table, after in zip(published.tables(shipped(), {name: OURS}), (first, third), strict=True):
        assert (name in names(table.rows)) is (after is not None)
        if after is not None:
            place = names(table.rows).index(name)
            assert names(table.rows)[place - 1] == after
            assert table.rows[place].ours
            assert table.rows[place].values == (0.5, 0.5, 0.5, 0.5, 0.995)
            assert table.best[-1] == 0.995


def test_several_rows_of_ours_keep_their_order() -> None:
    table = published.tables(shipped(), {"eye + Pose": OURS, "other + Pose": OURS, "eye": OURS})[0]
    ours = [row.name for row in table.rows if row.ours]
    assert ours == ["eye", "eye + Pose", "other + Pose"]


def test_without_published_results_ours_stand_alone(tmp_path: Path) -> None:
    assert published.read(tmp_path) is None
    (table,) = published.tables(None, {"eye": OURS})
    assert names(table.rows) == ["eye"]
    assert table.heads == tuple(HEADS.values())


FILE = """
source = "x"
columns = ["ap_micro"]
[[table]]
name = "T"
[table.rows]
"7B" = [0.5]
"""


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (FILE.replace("0.5", "0.5, 0.6"), "has 2 numbers, and there are 1 columns"),
        (FILE.replace("0.5", '"a"'), "table.0.rows.7B.0"),
        (FILE.replace("ap_micro", "ap_mikro"), "did you mean 'ap_micro'"),
        (FILE.replace("source", "sauce"), "sauce: unknown key; did you mean 'source'?"),
        (FILE.replace("[[table]]", "[[table]"), "is not TOML"),
        ('curves = ["on("]\n' + FILE, "is not an atom"),
    ],
)
def test_a_mistake_is_named(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / published.FILE).write_text(text, encoding="utf-8")
    with pytest.raises(DomainError) as told:
        published.read(tmp_path)
    assert message in str(told.value)
    assert published.FILE in str(told.value)


def test_tables_with_groups_have_a_row_of_ours_for_each() -> None:
    blocks = published.read(ROOT / "domains" / "blocksworld")
    assert blocks is not None
    five, six = blocks.table
    sizes, modified = ("0.5B", "7B", "72B"), ("", " + Instruct")
    assert list(five.rows) == [f"{s}{m} (≤ {n})" for s in sizes for m in modified for n in (3, 5, 7, 10)]
    assert len(six.rows) == 30
    assert five.rows["72B + Instruct (≤ 10)"] == [0.74, 0.77, 0.80, 0.64, 0.64]
    assert six.rows["7B (metal only)"] == [0.78, 0.81, 0.82, 0.68, 0.93]
    here = {"at most 3": OURS, "at most 10": OURS, "rubber-only": OURS}
    ours = {"eye + Instruct + Pose": {**OURS, "groups": here}, "eye": {**OURS, "groups": here}}
    made = published.tables(blocks, ours)
    for table, labels in zip(made, (["≤ 3", "≤ 10"], ["rubber only"]), strict=True):
        rows = names(table.rows)
        for name, after in (("eye + Instruct + Pose", "72B + Instruct"), ("eye", "72B")):
            place = rows.index(f"{name} ({labels[0]})")
            assert rows[place : place + len(labels)] == [f"{name} ({label})" for label in labels]
            assert rows[place - 1].startswith(f"{after} (")


def test_a_group_is_one_thing(tmp_path: Path) -> None:
    text = 'source = "x"\ncolumns = ["ap_micro"]\n[[table]]\nname = "T"\nrows = {}\n[table.groups]\na = {}\n'
    (tmp_path / published.FILE).write_text(text, encoding="utf-8")
    with pytest.raises(DomainError, match=r"table.groups.'a'.*'most' or 'subset'"):
        published.read(tmp_path)
