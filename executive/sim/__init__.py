"""The simulated world: MuJoCo with robosuite's assets. `truth` is for scoring and for the oracle alone."""
