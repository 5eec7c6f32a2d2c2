"""What an OpenAI-compatible server with a checkpoint would say: the chat template, one full forward pass for each
question, and the most likely next tokens as text. Of Executive's own backends it shares no more than the processor,
which the tests of those hold against other ones."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from executive.s3e.backends.checkpoint import inspect
from executive.s3e.backends.loading import load_processor
from tests.executive.s3e.chat_server import Request, Response, completion


def served(folder: Path) -> Callable[[Request], Response]:
    """A response to each request, from the image-text-to-text checkpoint in a folder."""
    import torch
    from transformers import AutoModelForImageTextToText

    processor: Any = load_processor(inspect(folder, folder.name))
    model: Any = AutoModelForImageTextToText.from_pretrained(folder, dtype=torch.float32).eval()
    one_at_a_time = threading.Lock()

    def respond(request: Request) -> Response:
        kinds = {"image_url": {"type": "image"}}
        messages = [
            {"role": message["role"], "content": [{"type": "text", "text": message["content"]}]}
            if isinstance(message["content"], str)
            else {**message, "content": [kinds.get(part["type"], part) for part in message["content"]]}
            for message in request.body["messages"]
        ]
        with one_at_a_time, torch.no_grad():
            text = processor.apply_chat_template(messages, add_generation_prompt=True)
            inputs = processor(text=[text], images=[request.images], return_tensors="pt")
            probabilities = model(**inputs).logits[0, -1].double().softmax(-1)
        top = probabilities.topk(min(request.body["top_logprobs"], len(probabilities)))
        pairs = zip(top.indices.tolist(), top.values.tolist(), strict=True)
        return completion([(processor.tokenizer.decode([token]), p) for token, p in pairs])

    return respond
