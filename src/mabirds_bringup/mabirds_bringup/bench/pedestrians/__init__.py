"""Real people who pass each other: learned from a part of the time, judged by the rest."""
