"""Cost models: how omega becomes what a policy pays."""
