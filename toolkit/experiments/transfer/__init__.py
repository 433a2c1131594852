"""Do boosters hold before networks that they never saw: trained on all but one, judged by that one."""
