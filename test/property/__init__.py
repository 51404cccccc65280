"""Sentences that hold for all inputs; one file a module of core where such a sentence is known."""
