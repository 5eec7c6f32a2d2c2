"""The networks that `executive train` makes, computed with NumPy: a ResNet that sees, a Qwen2 decoder that answers.

Importing torch and transformers takes longer than all looks of a run together, and more memory than all else of it.
What a network of four million parameters computes needs neither. The formulas are those of the families in
transformers, which the weights come from; `tests/executive/s3e/backends/test_numpy_backend.py` compares the two.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeAlias

import numpy as np

Array: TypeAlias = "np.ndarray[Any, Any]"
"""Of float32."""

Weights: TypeAlias = "Mapping[str, Array]"

KeysAndValues: TypeAlias = "list[tuple[Array, Array]]"
"""Of each layer, what later tokens see of earlier ones: keys and values, (heads, tokens, width of a head) each."""

_VARIANCE_FLOOR = 1e-5
"""Added to a variance before its root in batch normalisation: torch's default, which the family keeps."""

_TOWER, _DECODER, _PROJECTOR = "model.vision_tower", "model.language_model", "model.multi_modal_projector"


class VisionEncoder:
    """A ResNet of basic layers, and the projector from what it sees to tokens of the decoder.

    Args:
        weights: by their names in the checkpoint.
        config: the checkpoint's `vision_config`.
        threads: pictures that are looked at together.
    """

    def __init__(self, weights: Weights, config: Mapping[str, Any], threads: int) -> None:
        self._stem = _Convolution(weights, f"{_TOWER}.embedder.embedder", stride=2)
        self._stages = []
        for stage, depth in enumerate(config["depths"]):
            for layer in range(depth):
                name = f"{_TOWER}.encoder.stages.{stage}.layers.{layer}"
                stride = 2 if stage > 0 and layer == 0 else 1  # the first stage keeps its size
                has_shortcut = f"{name}.shortcut.convolution.weight" in weights
                shortcut = _Convolution(weights, f"{name}.shortcut", stride) if has_shortcut else None
                first = _Convolution(weights, f"{name}.layer.0", stride)
                self._stages.append((first, _Convolution(weights, f"{name}.layer.1", 1), shortcut))
        self._projector = [
            (np.ascontiguousarray(weights[f"{_PROJECTOR}.{name}.weight"].T), weights[f"{_PROJECTOR}.{name}.bias"])
            for name in ("linear_1", "linear_2")
        ]
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix="picture")

    def tokens(self, pictures: Sequence[Array]) -> Array:
        """Return the tokens of pictures, (H, W, 3) each, one picture after the other: (tokens, width)."""
        return np.concatenate(list(self._pool.map(self._tokens, pictures)))

    def _tokens(self, picture: Array) -> Array:
        seen = _pooled(np.maximum(self._stem(picture), 0.0))
        for first, second, shortcut in self._stages:
            kept = seen if shortcut is None else shortcut(seen)
            seen = np.maximum(second(np.maximum(first(seen), 0.0)) + kept, 0.0)
        (weight, bias), (weight_2, bias_2) = self._projector
        tokens: Array = _gelu(seen.reshape(-1, seen.shape[-1]) @ weight + bias) @ weight_2 + bias_2
        return tokens


class _Convolution:
    """A convolution with the batch normalisation that follows it, which at this time is a factor and an offset."""

    def __init__(self, weights: Weights, name: str, stride: int) -> None:
        kernel = weights[f"{name}.convolution.weight"]  # (out, in, side, side)
        mean, variance, scale, offset = (
            weights[f"{name}.normalization.{part}"] for part in ("running_mean", "running_var", "weight", "bias")
        )
        factor = scale / np.sqrt(variance + np.float32(_VARIANCE_FLOOR))
        self._side, self._stride = kernel.shape[-1], stride
        folded = (kernel * factor[:, None, None, None]).transpose(2, 3, 1, 0)
        self._matrix = np.ascontiguousarray(folded.reshape(-1, len(kernel)))
        self._offset = offset - mean * factor

    def __call__(self, image: Array) -> Array:
        """(H, W, channels) -> (H', W', channels'), with zeros around the image."""
        side, stride = self._side, self._stride
        if side == 1:
            rows = image[::stride, ::stride]
            return rows @ self._matrix + self._offset
        windows = _windows(np.pad(image, [(side // 2, side // 2)] * 2 + [(0, 0)]), side, stride)
        height, width = windows.shape[:2]
        product = windows.reshape(height * width, -1) @ self._matrix
        product += self._offset
        return product.reshape(height, width, -1)


def _windows(image: Array, side: int, stride: int) -> Array:
    """A view of every window of an image: (H', W', side, side, channels)."""
    height, width = ((size - side) // stride + 1 for size in image.shape[:2])
    down, right, deep = image.strides
    return np.lib.stride_tricks.as_strided(
        image,
        (height, width, side, side, image.shape[2]),
        (down * stride, right * stride, down, right, deep),
        writeable=False,
    )


def _pooled(image: Array) -> Array:
    """The largest of each window of 3x3, every second one."""
    padded = np.pad(image, ((1, 1), (1, 1), (0, 0)), constant_values=-np.inf)
    pooled: Array = _windows(padded, 3, 2).max(axis=(2, 3))
    return pooled


def _gelu(values: Array) -> Array:
    """x * Phi(x), with erf as in Abramowitz and Stegun, 7.1.26: off by 1.5e-7 at most."""
    magnitude = np.abs(values) * np.float32(math.sqrt(0.5))
    t = 1.0 / (1.0 + 0.3275911 * magnitude)
    series = t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))))
    erf = np.sign(values) * (1.0 - series * np.exp(-magnitude * magnitude))
    result: Array = (0.5 * values * (1.0 + erf)).astype(np.float32)
    return result


class Decoder:
    """A Qwen2 decoder.

    Args:
        weights: by their names in the checkpoint.
        config: the checkpoint's `text_config`.
    """

    def __init__(self, weights: Weights, config: Mapping[str, Any]) -> None:
        self.embeddings = weights[f"{_DECODER}.embed_tokens.weight"]
        self._norm = weights[f"{_DECODER}.norm.weight"]
        self._heads, self._floor = int(config["num_attention_heads"]), np.float32(config["rms_norm_eps"])
        width = self.embeddings.shape[1] // self._heads
        exponents = np.arange(0, width, 2, dtype=np.float32) / width
        self._frequencies = (1.0 / float(config["rope_parameters"]["rope_theta"]) ** exponents).astype(np.float32)
        self._layers = [
            _Layer(weights, f"{_DECODER}.layers.{layer}") for layer in range(int(config["num_hidden_layers"]))
        ]

    def read(
        self, tokens: Array, positions: np.ndarray[Any, Any], mask: Array, past: KeysAndValues | None = None
    ) -> tuple[Array, KeysAndValues]:
        """Run tokens through all layers.

        Args:
            tokens: (T, width) embeddings.
            positions: (T,) each token's position in its prompt.
            mask: (T, P + T) what is added to each token's scores for the P tokens of `past` and these.

        Returns:
            (T, width) what the last layer makes of them, and the keys and values of these tokens.
        """
        angles = positions[:, None].astype(np.float32) * self._frequencies
        angles = np.concatenate([angles, angles], axis=1)
        turn = np.cos(angles), np.sin(angles)
        kept: KeysAndValues = []
        for index, layer in enumerate(self._layers):
            normed = self._normed(tokens, layer.before)
            keys, values = (
                _turned(self._split(normed @ layer.key + layer.key_bias), turn),
                self._split(normed @ layer.value + layer.value_bias),
            )
            kept.append((keys, values))
            if past is not None:
                keys, values = (np.concatenate(pair, axis=1) for pair in zip(past[index], (keys, values), strict=True))
            queries = _turned(self._split(normed @ layer.query + layer.query_bias), turn)
            scores = queries @ keys.transpose(0, 2, 1) * np.float32(queries.shape[-1] ** -0.5) + mask
            scores -= scores.max(axis=-1, keepdims=True)
            np.exp(scores, out=scores)
            scores /= scores.sum(axis=-1, keepdims=True)
            tokens = tokens + (scores @ values).transpose(1, 0, 2).reshape(tokens.shape) @ layer.out
            normed = self._normed(tokens, layer.after)
            gate = normed @ layer.gate
            tokens = tokens + (gate / (1.0 + np.exp(-gate)) * (normed @ layer.up)) @ layer.down
        return tokens, kept

    def logits(self, tokens: Array) -> Array:
        """The outputs for what the last layer has made of tokens: (T, width) -> (T, vocabulary)."""
        outputs: Array = self._normed(tokens, self._norm) @ self.embeddings.T
        return outputs

    def _normed(self, tokens: Array, weight: Array) -> Array:
        mean = np.mean(tokens * tokens, axis=-1, keepdims=True)
        normed: Array = weight * (tokens / np.sqrt(mean + self._floor))
        return normed

    def _split(self, tokens: Array) -> Array:
        """(T, width) -> (heads, T, width of a head)."""
        return tokens.reshape(len(tokens), self._heads, -1).transpose(1, 0, 2)


class _Layer:
    """The weights of a layer, each as what tokens are multiplied by."""

    def __init__(self, weights: Weights, name: str) -> None:
        def matrix(part: str) -> Array:
            return np.ascontiguousarray(weights[f"{name}.{part}.weight"].T)

        self.before = weights[f"{name}.input_layernorm.weight"]
        self.after = weights[f"{name}.post_attention_layernorm.weight"]
        self.query, self.key, self.value = (matrix(f"self_attn.{letter}_proj") for letter in "qkv")
        self.query_bias, self.key_bias, self.value_bias = (weights[f"{name}.self_attn.{c}_proj.bias"] for c in "qkv")
        self.out = matrix("self_attn.o_proj")
        self.gate, self.up, self.down = (matrix(f"mlp.{part}_proj") for part in ("gate", "up", "down"))


def _turned(heads: Array, turn: tuple[Array, Array]) -> Array:
    """Rotary positions: each pair of values is turned by an angle that grows with the position."""
    half = heads.shape[-1] // 2
    across = np.concatenate([-heads[..., half:], heads[..., :half]], axis=-1)
    turned: Array = heads * turn[0] + across * turn[1]
    return turned
