"""The training loop, and classifiers trained from renders or from a folder of images."""
