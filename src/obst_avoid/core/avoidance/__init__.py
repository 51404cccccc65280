"""From obstacles and lane pose to a decision. `decide` in avoider.py is the one public question."""
