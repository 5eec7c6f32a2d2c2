"""The films and recordings in docs/gallery."""
