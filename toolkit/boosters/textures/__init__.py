"""Textures: Algorithm 2 of the seed, on the rig."""
