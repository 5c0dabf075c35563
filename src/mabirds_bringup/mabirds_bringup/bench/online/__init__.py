"""How many demonstrations a second are learned through ROS, by learners and by central methods."""
