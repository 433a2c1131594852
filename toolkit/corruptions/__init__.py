"""The corruptions of ImageNet-C and CIFAR-10-C: batched, on CPU or GPU, seeded per image."""
