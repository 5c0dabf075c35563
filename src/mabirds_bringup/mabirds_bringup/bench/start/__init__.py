"""What it takes until something answers: the list of verbs, and a learner, against a bare node of rclpy."""
