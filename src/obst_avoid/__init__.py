"""Detection and avoidance of duckies and cones for Duckietown robots."""
