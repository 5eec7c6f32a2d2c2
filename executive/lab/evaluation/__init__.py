"""Experiment 1 of the S3E paper: how well a model sees, measured and reported; calibration from it."""
