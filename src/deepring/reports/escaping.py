"""Plain text as HTML."""

import html

from deepring.text import printable


def escaped(text: str) -> str:
    """Plain text as HTML, in an element or between the quotes of an attribute.

    What does not print is escaped first, so that no mark of direction turns the text around.
    """
    return html.escape(printable(text))
