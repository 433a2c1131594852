"""What is photographed: specs, meshes, textures, and the files of what is put on an object."""
