"""Profile `paper`: the report's algorithm, faithfully. The reference and the baseline."""
