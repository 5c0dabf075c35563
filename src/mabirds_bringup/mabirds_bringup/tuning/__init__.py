"""Settings chosen by recordings that learners have, and by no others."""
