"""The durable record of a run: events, pictures, snapshots of the world, and the monitor they were judged with."""
