"""How the trees of the profile robust are grown from labelled pictures."""
