"""Settings of the property tests in this folder."""

from hypothesis import settings

# Examples are not timed: a busy machine must not fail a test.
settings.register_profile("core", deadline=None)
settings.load_profile("core")
