"""Draws results on a copy of a picture. Never ROS."""
