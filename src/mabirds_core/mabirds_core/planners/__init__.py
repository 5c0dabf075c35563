"""From theta and omega to the constrained soft Bellman policy, and following it."""
