"""Algorithm 1: parameters, gradients of G, and a learner's online iteration."""
