"""What happens to a booster between file and photograph, as transforms in expectation (Athalye et al. 2018)."""
