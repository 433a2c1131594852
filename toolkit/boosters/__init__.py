"""Boosters of an object: unadversarial patches, textures and wraps, and their training."""
