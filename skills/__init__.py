"""The skills of the robot: each executes one kind of step on the robot handle of the world."""
