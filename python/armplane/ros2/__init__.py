"""A run on the topics of ROS 2: `armplane servo ur5 --ros2`, `armplane run SCENARIO --ros2` (docs/ros2.md)."""
