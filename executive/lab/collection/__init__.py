"""Data sets of pictures and the truth about them, from random actions in simulation."""
