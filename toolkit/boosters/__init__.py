"""What is added to an object: unadversarial patches and textures, and what they meet in training."""
