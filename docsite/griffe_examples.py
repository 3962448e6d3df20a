"""Docstrings as Markdown, for mkdocstrings: their doctests become code blocks."""

from typing import Any

import griffe

from docsite.markdown import fenced


class Examples(griffe.Extension):
    """Fences the doctests of each docstring."""

    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        """Change the docstring of an object that was read."""
        if obj.docstring is not None:
            obj.docstring.value = fenced(obj.docstring.value)
