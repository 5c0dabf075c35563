"""The network as processes: starting, supervising and ending them."""
