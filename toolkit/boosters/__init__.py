"""What is added to an object: unadversarial patches."""
