"""From answers to numbers, figures and a report."""
