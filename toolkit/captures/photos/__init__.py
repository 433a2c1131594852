"""Photographs as cameras write them: pixels, metadata, RAW previews and films."""
