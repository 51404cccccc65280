"""What the tool `evaluate` is made of: labels, matching, tallies, figures, work in parallel, and pages."""
