"""The printed sheet in a photograph: where it lies, how large it is, and which colours it has."""
