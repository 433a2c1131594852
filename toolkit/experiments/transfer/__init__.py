"""Do boosters work on networks that they were not trained on: train on all but one, test on that one."""
