"""Capture folders: shoot them, read them, and decide which images count."""
