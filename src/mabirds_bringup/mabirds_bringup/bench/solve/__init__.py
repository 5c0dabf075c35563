"""``mabirds bench solve``: how fast policies and expectations are found, against limits, peers and the reference."""
