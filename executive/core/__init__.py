"""The loop and what it decides with: look, plan, do one step, look, compare, decide. `loop.py` reads top to bottom."""
