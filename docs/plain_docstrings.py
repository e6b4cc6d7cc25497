"""Reads docstrings as plain text where they are shown on the site: x* is a point, not the beginning of italics.

An extension of Griffe, which reads the sources for the API pages. Lines such as `name: meaning`, by which some classes
describe their options, become lists.
"""

import re
from typing import Any

from griffe import Extension, Object

CODE = re.compile(r"(`[^`]*`|(?<=\n\n)(?: {4}.*\n?)+|(?m:^ {4}>>> .*\n(?: {4}.+\n?)*))")  # in backticks, or indented
OPTION = re.compile(r"^([a-z_][\w, ]{0,40}): ", re.M)


class PlainDocstrings(Extension):
    """Escapes what Markdown would take for markup."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Change the docstring of one object."""
        if obj.docstring is not None:
            obj.docstring.value = plain(obj.docstring.value, of_class=obj.is_class)


def plain(text: str, of_class: bool = False) -> str:
    """Return a docstring with its asterisks, underscores and brackets kept."""
    parts = CODE.split(text)
    parts[::2] = [re.sub(r"([*<])", r"\\\1", part) for part in parts[::2]]
    joined = "".join(parts)
    return _listed(joined) if of_class else joined


def _listed(text: str) -> str:
    """Return paragraphs of which every line begins with an option's name, or goes on from one, as lists."""
    paragraphs = text.split("\n\n")
    return "\n\n".join(OPTION.sub(r"* **\1**: ", part) if OPTION.match(part) else part for part in paragraphs)
