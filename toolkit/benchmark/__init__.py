"""The corruption benchmark: a data set boosted with patches, corrupted, and shown to a classifier (seed, section D)."""
