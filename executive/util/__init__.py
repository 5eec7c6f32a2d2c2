"""Files, time limits and processes: nothing in here knows what an executive is."""
