"""Texts of others, made fit to be shown: what came from a file or a network floods no log and steers no terminal."""


def truncate(text: str, most: int = 80) -> str:
    """The text, or its first ``most`` characters and how many there were.

    >>> truncate("digest" * 100, most=9)
    'digestdig... (600 characters)'
    """
    return text if len(text) <= most else f"{text[:most]}... ({len(text)} characters)"


def sanitize(text: str, most: int = 300) -> str:
    r"""The text on one line, ``truncate``, with everything escaped that is no character to be seen.

    >>> sanitize("all is well\n\x1b[2J")
    'all is well\\n\\x1b[2J'
    """
    seen = "".join(char if char.isprintable() else ascii(char)[1:-1] for char in text[:most])
    return seen if len(text) <= most else f"{seen}... ({len(text)} characters)"
