"""Nodes, their parameters, and the one border between messages and types."""
