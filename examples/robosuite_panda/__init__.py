"""A Franka Panda in robosuite's own environment, with its own controller: see panda.py."""
