"""Films of runs, with the truth of every frame, and how well an estimator does on them (the paper's Experiment 2)."""
