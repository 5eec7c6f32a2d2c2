"""Public planning tasks: which are read, planned for and played, as tables.

    python -m benchmarks.pddl FOLDER                 # reads all of them, which takes a minute
    python -m benchmarks.pddl FOLDER --only loop ... # another part, with options of its own

FOLDER has `accepted.jsonl`, the tasks that Fast Downward's translator accepts, one a line ({"domain", "problem"}), and
may have `refused.jsonl`, the others. Each part is a program by itself, too: `python -m benchmarks.pddl.reading FOLDER`.
"""

from __future__ import annotations

import argparse
import importlib
import sys

PARTS = ("reading", "planning", "loop")
"""Each a module here with a function `main`, which takes the arguments."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=PARTS, nargs="+", default=PARTS[:1])
    arguments, others = parser.parse_known_args()
    return max(int(importlib.import_module(f"benchmarks.pddl.{part}").main(others)) for part in arguments.only)


if __name__ == "__main__":
    sys.exit(main())
