"""How learners agree: edge schedules, mixing weights, and what is mixed with what."""
