"""Experts that demonstrate, the recorder to bags, and the node that plays bags to learners."""
