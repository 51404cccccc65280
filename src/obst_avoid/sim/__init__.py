"""Pictures and recordings without a robot. Never ROS."""
