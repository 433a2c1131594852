"""Landing a drone on a pad by what its camera sees (paper, appendix B.3): data, regressor, flight, boosted pad."""
