"""Whole experiments: each gives the units of its run, the work of one unit, and its own figures."""
