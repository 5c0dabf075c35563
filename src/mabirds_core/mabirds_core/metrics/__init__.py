"""How well learners imitate, and what they take for a constraint."""
