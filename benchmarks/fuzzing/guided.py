"""One target under atheris: `python -m benchmarks.fuzzing.guided TARGET FOLDER INPUTS`, in a process of its own.

atheris watches which lines of Executive's own code an input reaches, and goes on from inputs that reach new ones. The
last line on stdout is `done INPUTS TAKEN`. What goes wrong ends the process; its input is in FOLDER/found.
"""

from __future__ import annotations

import sys
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["executive"]):
    from benchmarks.fuzzing.targets import TARGETS
    from benchmarks.fuzzing.watch import judged


def main() -> None:
    name, place, inputs = sys.argv[1:]
    target, folder = TARGETS[name], Path(place)
    corpus, scratch = folder / "corpus", folder / "scratch"
    for made in (corpus, scratch, folder / "found"):
        made.mkdir(parents=True, exist_ok=True)
    for number, seed in enumerate(target.seeds()):
        (corpus / f"seed-{number}").write_bytes(seed)
    dictionary = folder / "words"
    dictionary.write_text("".join(f'"{_escaped(word)}"\n' for word in target.words if word), encoding="ascii")
    count = taken = 0

    def one(data: bytes) -> None:
        nonlocal count, taken
        count += 1
        taken += judged(target.read, data, scratch)
        if count == int(inputs):
            print(f"done {count} {taken}", flush=True)

    options = [f"-runs={inputs}", f"-dict={dictionary}", f"-artifact_prefix={folder / 'found'}/", "-max_len=20000"]
    atheris.Setup([sys.argv[0], *options, "-timeout=60", "-rss_limit_mb=0", "-print_final_stats=0", str(corpus)], one)
    atheris.Fuzz()


def _escaped(word: str) -> str:
    return "".join(
        chr(byte) if 32 < byte < 127 and chr(byte) not in '"\\' else f"\\x{byte:02x}" for byte in word.encode()
    )


if __name__ == "__main__":
    main()
