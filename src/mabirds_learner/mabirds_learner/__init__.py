"""The learner node: a thin shell over mabirds_core."""
