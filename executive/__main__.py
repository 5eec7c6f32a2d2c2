"""The command `executive`, also as `python -m executive`."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line; a Ctrl-C while it is still loading ends it as quietly as one later on."""
    try:
        from executive.cli import main as run
    except KeyboardInterrupt:
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()
