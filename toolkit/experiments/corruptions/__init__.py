"""The corruption benchmark: a data set with patches in it, corrupted, shown to a classifier (the paper, Appendix D)."""
