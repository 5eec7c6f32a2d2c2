"""Watchers of a run: the durable record, the live view in a terminal, the Rerun viewer, and the summary at the end.

Importing this package loads none of them; rerun and rich are loaded by the module that needs them.
"""
