"""What can be wrong with a bag."""

from mabirds_core.errors import MabirdsError


class BagError(MabirdsError):
    """A bag that cannot be written or must not be used; names file, topic and iteration where they are known."""
