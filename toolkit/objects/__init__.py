"""Objects to photograph: specs, meshes, textures, and the files of boosters."""
