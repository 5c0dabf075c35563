"""The drone game (paper, section 5.2)."""
