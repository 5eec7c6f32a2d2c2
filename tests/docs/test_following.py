"""Whoever follows the documents for us notices when they are wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.docs.following import DOCUMENTS, LANGUAGES, Follower, blocks


def follow(folder: Path, text: str) -> Follower:
    document = folder / "document.md"
    document.write_text(text)
    (folder / "here").mkdir()
    reader = Follower(folder)
    reader.here = folder / "here"
    for block in blocks(document):
        reader.follow(block)
    return reader


def test_what_is_right_is_followed(tmp_path: Path) -> None:
    reader = follow(
        tmp_path,
        "Go:\n```sh\nmkdir deep && cd deep\n```\nWrite `list.toml`:\n<!-- file list.toml -->\n```toml\na = 1\n```\n"
        "and more of `list.toml`:\n<!-- append list.toml -->\n```toml\nb = 2\n```\n```sh\ncat list.toml; tput cols\n"
        "```\n```text\na = 1\n...\n80\n```\n<!-- exit 3 -->\n```sh\nexit 3\n```\n"
        "<!-- not run: it never ends -->\n```sh\nsleep 1000\n```\n```python\nanything(\n```\n",
    )
    assert reader.here == tmp_path / "here" / "deep"
    assert (reader.here / "list.toml").read_text() == "a = 1\nb = 2\n"


@pytest.mark.parametrize(
    "text",
    [
        "```sh\nfalse\n```\n",
        "```sh\nfalse\ntrue\n```\n",
        "<!-- exit 3 -->\n```sh\ntrue\n```\n",
        "<!-- exit 0 or 1 -->\n```sh\nexit 2\n```\n",
        "```sh\necho one; echo two\n```\n```text\ntwo\none\n```\n",
        "```sh\necho one two\n```\n```text\none\n```\n",
        "```text\nnothing was printed\n```\n",
        "Write this somewhere:\n<!-- file list.toml -->\n```toml\na = 1\n```\n",
        "`list.toml`:\n<!-- fil list.toml -->\n```toml\na = 1\n```\n",
        "<!-- exit 0 -->\n```text\n```\n",
        "<!-- not run -->\n```sh\ntrue\n```\n",
        "`../../x`:\n<!-- file ../../x -->\n```toml\na = 1\n```\n",
    ],
)
def test_what_is_wrong_is_noticed(text: str, tmp_path: Path) -> None:
    with pytest.raises(AssertionError):
        follow(tmp_path, text)


def test_a_file_that_is_there_is_not_a_new_one(tmp_path: Path) -> None:
    twice = "Write `a.toml`:\n<!-- file a.toml -->\n```toml\n```\n" * 2
    with pytest.raises(FileExistsError):
        follow(tmp_path, twice)


def test_what_never_ends_is_ended(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="ends with -9"):
        Follower(tmp_path).type("sleep 1000", patience=0.5)


def test_of_a_live_view_what_stays_is_kept(tmp_path: Path) -> None:
    reader = Follower(tmp_path)
    assert reader.type(r"printf 'gone\033[?25l\033[2K\033[?25h\033[32mstays\033[0m\n'") == "stays\n"


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_every_block_says_what_it_is(document: Path) -> None:
    for block in blocks(document):
        assert block.language in LANGUAGES, block
    assert document.read_text(encoding="utf-8").count("```") == 2 * len(list(blocks(document)))
