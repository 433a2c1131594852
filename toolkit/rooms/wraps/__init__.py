"""Wraps: flat pieces of an object's surface, planned, trained, printed, cut out and stuck on."""
