"""A live page of a running network."""
