"""Where to look first for what cannot be seen: ways to decide it, on many worlds of atoms."""
