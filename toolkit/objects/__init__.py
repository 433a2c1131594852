"""What is photographed: specs, built-in meshes, and the user's own."""
