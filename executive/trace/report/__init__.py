"""What a run came to: the summary, and the run retold in sentences."""
