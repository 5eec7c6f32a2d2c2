"""The benchmark of looks on a GPU: its code on a CPU, with a tiny model; and what it says without a GPU."""

from __future__ import annotations

import json
import sys

import pytest
import torch

from benchmarks import gpu


def test_a_look_is_measured_in_both_ways(one_thread: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gpu, "ROUNDS", 1)
    rows = list(gpu.measure(["tiny"], ["float32"], [1, 6], 1, "cpu"))
    assert [(row.size, row.dtype, row.questions, row.note) for row in rows] == [
        ("tiny", "float32", 1, ""),
        ("tiny", "float32", 6, ""),
    ]
    for row in rows:
        assert row.shared is not None
        assert row.alone is not None
        assert row.ratio == pytest.approx(row.alone / row.shared)
        assert row.gibibytes is None, "there is no GPU in it"
    lines = gpu.printed(rows).splitlines()
    assert len(lines) == 2 + len(rows)
    assert lines[3].startswith("| tiny | float32 | 1 | 6 |")


def test_the_shapes_have_the_parameters_of_their_names() -> None:
    """Counted without memory: weights of the device `meta` have none."""
    from transformers import Qwen2Config, Qwen2ForCausalLM

    for name, billions in (("0.5B", 0.5), ("7B", 7.6)):
        shape = gpu.SHAPES[name]
        config = Qwen2Config(
            hidden_size=shape.width, intermediate_size=shape.inner, num_hidden_layers=shape.layers,
            num_attention_heads=shape.heads, num_key_value_heads=shape.key_value_heads, vocab_size=shape.vocabulary,
            tie_word_embeddings=name == "0.5B",
        )  # fmt: skip
        with torch.device("meta"):
            model = Qwen2ForCausalLM(config)
        assert sum(each.numel() for each in model.parameters()) / 1e9 == pytest.approx(billions, rel=0.05)


def test_without_a_gpu_it_says_so(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 0)
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)
    monkeypatch.setattr(sys, "argv", ["gpu", "--json"])
    gpu.main()
    assert "no GPU" in json.loads(capsys.readouterr().out)["skipped"]
    assert gpu.missing("cuda:7") != ""
    assert gpu.missing("cpu") == ""
