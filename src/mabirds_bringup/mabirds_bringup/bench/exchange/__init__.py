"""What the exchange of learners costs, against nodes of rclpy that pass the same messages and do nothing else."""
