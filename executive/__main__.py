"""`python -m executive` is the command `executive`."""

from executive.cli import main

main()
