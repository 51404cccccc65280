"""The algorithms, from picture to command: numpy and OpenCV, never ROS, never a clock."""
