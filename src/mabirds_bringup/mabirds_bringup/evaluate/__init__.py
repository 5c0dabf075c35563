"""From learned parameters to rates and tables."""
