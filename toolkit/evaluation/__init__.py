"""From predictions to metrics, table and report."""
