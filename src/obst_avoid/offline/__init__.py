"""Tools over pictures and bags, on the same code path as the nodes."""
