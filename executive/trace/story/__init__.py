"""What the events of a run amount to at each moment; terminal and viewer show it."""
