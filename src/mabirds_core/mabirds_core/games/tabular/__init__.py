"""What all games share that are small enough to enumerate."""
