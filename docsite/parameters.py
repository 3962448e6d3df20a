"""The parameters of a class as its source states them: type, default, and what each is."""

import ast
import dataclasses
import inspect
import re
import textwrap
import tokenize
from functools import cache
from io import StringIO
from typing import Any, NamedTuple

#: Packages whose own docs tell what their arguments are.
_FOREIGN = ("abc", "builtins", "lightning", "torch", "typing")


class Parameter(NamedTuple):
    """One argument of a class."""

    type: str
    """As written in the source; empty where nothing is."""
    default: Any
    """`inspect.Parameter.empty` where it must be given."""
    comment: str


def parameters(target: Any) -> dict[str, Parameter]:
    """The arguments of a class by name, with those that it inherits."""
    try:
        signature = inspect.signature(target)
    except (TypeError, ValueError):
        return {}
    comments = _comments(target)
    kinds = (inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL)
    return {
        name: Parameter(
            _words(each.annotation),
            _default(target, each),
            comments.get(name) or _in_prose(target, name),
        )
        for name, each in signature.parameters.items()
        if each.kind not in kinds
    }


def comments_in(source: str) -> dict[str, str]:
    """What a class body says of its fields, by name.

    That is the ``#:`` lines above a field, the comment behind it, or the text below it.
    """
    body = next(node for node in ast.parse(source).body if isinstance(node, ast.ClassDef)).body
    lines, notes = _comment_lines(source), {}
    for field, after in zip(body, [*body[1:], None], strict=True):
        if not isinstance(field, ast.AnnAssign) or not isinstance(field.target, ast.Name):
            continue
        above, line = [], field.lineno - 1
        while lines.get(line, "").startswith("#:"):
            above.insert(0, lines[line].removeprefix("#:").strip())
            line -= 1
        text = " ".join(above) or lines.get(field.end_lineno or 0, "").lstrip("#: ")
        if not text and isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            text = " ".join(str(after.value.value).split())
        if text:
            notes[field.target.id] = text
    return notes


def arguments_in(docstring: str) -> dict[str, str]:
    """The entries of the part ``Args:`` of a docstring, by name; one may be of several names."""
    part = re.search(r"^Args:\n((?:    .*\n?|\n)+)", docstring, re.MULTILINE)
    if part is None:
        return {}
    entries = re.findall(
        r"^(\w+(?:, \w+)*): (.*(?:\n +.*)*)", textwrap.dedent(part[1]), re.MULTILINE
    )
    return {name: " ".join(text.split()) for names, text in entries for name in names.split(", ")}


def sentences_about(docstring: str, name: str) -> str:
    """The sentences of a docstring that say something of the argument ``name``, at most two.

    Examples, and the parts for arguments and errors, do not count.
    """
    prose = re.split(r"\n *(?:Args|Raises|Returns):|\n+ *>>>", docstring)[0]
    found = []
    for paragraph in re.split(r"\n\s*\n", prose):
        sentences = re.split(r"(?<=[a-z0-9)\]`]\.)\s+(?=[A-Z])", " ".join(paragraph.split()))
        found += [sentence for sentence in sentences if f"``{name}``" in sentence]
    return " ".join(found[:2])


def _in_prose(target: Any, name: str) -> str:
    """What the docstring of a class, or else of a base of it, says of an argument."""
    for cls in inspect.getmro(target) if inspect.isclass(target) else (target,):
        if cls.__module__.partition(".")[0] in _FOREIGN:
            continue
        if text := sentences_about(cls.__doc__ or "", name):
            return text
    return ""


def _comments(target: Any) -> dict[str, str]:
    notes: dict[str, str] = {}
    for cls in reversed(inspect.getmro(target) if inspect.isclass(target) else (target,)):
        if cls.__module__.partition(".")[0] not in _FOREIGN:
            notes |= _own_comments(cls)
    return notes


@cache
def _own_comments(cls: Any) -> dict[str, str]:
    """What a class itself, or a function, says of its arguments."""
    notes = arguments_in(inspect.getdoc(cls) or "")
    if inspect.isclass(cls):
        notes |= arguments_in(inspect.getdoc(cls.__init__) or "")
        notes |= comments_in(textwrap.dedent(inspect.getsource(cls)))
    return notes


def _comment_lines(source: str) -> dict[int, str]:
    tokens = tokenize.generate_tokens(StringIO(source).readline)
    return {each.start[0]: each.string for each in tokens if each.type == tokenize.COMMENT}


def _default(target: Any, parameter: inspect.Parameter) -> Any:
    """The default, made where a dataclass makes one for each object."""
    fields = getattr(target, "__dataclass_fields__", {})
    made = fields[parameter.name].default_factory if parameter.name in fields else None
    return made() if made not in (None, dataclasses.MISSING) else parameter.default


def _words(annotation: Any) -> str:
    if annotation is inspect.Parameter.empty:
        return ""
    text = annotation if isinstance(annotation, str) else inspect.formatannotation(annotation)
    text = re.sub(r"\b(?:[a-z_]+\.)+(?=\w)", "", text)
    return re.sub(r"Literal\[(.*?)\]", lambda found: found[1].replace(", ", " | "), text)
