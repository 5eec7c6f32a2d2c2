"""A skill that is learned from demonstrations, and what the loop around it is worth."""
