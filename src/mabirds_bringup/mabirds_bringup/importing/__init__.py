"""From recordings of several agents to demonstrations of a game."""
