"""Policies and policy finders."""
