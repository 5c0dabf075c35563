"""Texts of others, made fit to be shown: what came from a file or a network floods no log and steers no terminal."""


def truncate(text: str, most: int = 80) -> str:
    """Shorten a text.

    Parameters
    ----------
    text : str
        Of any length.
    most : int, optional
        Characters that are kept.

    Returns
    -------
    str
        The text, or its first characters and how many there were.

    Examples
    --------
    >>> truncate("digest" * 100, most=9)
    'digestdig... (600 characters)'
    """
    return text if len(text) <= most else f"{text[:most]}... ({len(text)} characters)"


def sanitize(text: str, most: int = 300) -> str:
    r"""Escape everything that is no character to be seen, and shorten.

    Parameters
    ----------
    text : str
        Of any length.
    most : int, optional
        Characters that are kept.

    Returns
    -------
    str
        On one line; the first characters and how many there were.

    Examples
    --------
    >>> sanitize("all is well\n\x1b[2J")
    'all is well\\n\\x1b[2J'
    """
    seen = "".join(char if char.isprintable() else ascii(char)[1:-1] for char in text[:most])
    return seen if len(text) <= most else f"{seen}... ({len(text)} characters)"
