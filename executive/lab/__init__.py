"""Experiments: data sets that a simulated robot collects. Nothing that runs a robot imports this package."""
