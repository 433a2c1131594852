"""Boosters of an object: unadversarial patches and textures, and their training."""
