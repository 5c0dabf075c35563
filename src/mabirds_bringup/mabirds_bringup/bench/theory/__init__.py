"""What Theorem 1 and Lemma 2 of the paper say, measured on a tiny game."""
