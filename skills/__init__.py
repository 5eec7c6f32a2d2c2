"""What the robot can do: each skill carries out one kind of step on the handle that the world gives."""
