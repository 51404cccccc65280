"""What lane paint in pictures says about a calibration. Free of ROS."""
