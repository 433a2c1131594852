"""Networks, their weights, labels and preprocessing."""
