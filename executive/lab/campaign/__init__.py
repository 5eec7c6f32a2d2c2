"""Campaigns: many episodes under many conditions, played side by side, scored, and compared (`executive bench`)."""
