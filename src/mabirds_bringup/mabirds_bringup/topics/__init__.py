"""Looking at any topic, parameter or service by name."""
