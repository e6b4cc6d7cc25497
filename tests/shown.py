"""What a page shows as output, compared with what is printed: numbers to a tolerance, words exactly."""

import re

from snippets import TIME

NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?(?!\w)")


def numbers(text: str) -> list[float]:
    """Return the numbers of a text, in order."""
    return [float(found) for found in NUMBER.findall(TIME.sub("", text))]


def words(text: str) -> list[str]:
    """Return the words of a text, of three letters or more, in order."""
    return re.findall(r"[A-Za-z]{3,}", text)
