"""Equations as MathML, which browsers draw without a script."""

import html
import re


def with_mathml(page: str) -> str:
    r"""A page's HTML with \( \) and \[ \] of its equations as MathML.

    Raises ValueError that quotes an equation which is no LaTeX.
    """
    return re.sub(
        r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', _mathml, page, flags=re.DOTALL
    )


def _mathml(found: re.Match[str]) -> str:
    from latex2mathml.converter import convert

    tag, bracket, latex = found.groups()
    display = "block" if bracket == "[" else "inline"
    try:
        mathml = convert(html.unescape(latex).strip(), display=display)
    except Exception as error:
        raise ValueError(f"equation {latex!r} is no LaTeX") from error
    return f'<{tag} class="equation">{mathml}</{tag}>'
