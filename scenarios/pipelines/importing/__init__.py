"""A lab's own files become a recording: CSV files with a mapping, or a ROS 2 bag."""
