"""The printed sheet in a photograph: place, size and colours."""
