"""``mabirds bench behaviour``: does the default rule learn what experts do, in games that nobody tuned for?"""
