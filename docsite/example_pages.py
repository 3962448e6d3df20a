"""A page for each script and notebook of examples/."""

import ast
import json
from collections.abc import Iterator
from pathlib import Path

FOLDER = "examples"


def example_pages(examples: Path) -> dict[str, str]:
    """The Markdown of the examples' pages by path."""
    pages = {f"{FOLDER}/{file.stem}.md": _script(file) for file in sorted(examples.glob("*.py"))}
    for file in sorted(examples.glob("*.ipynb")):
        pages[f"{FOLDER}/{file.stem}.md"] = "\n\n".join(_notebook(file)) + "\n"
    links = [f"- [{text.splitlines()[0][2:]}]({Path(path).name})" for path, text in pages.items()]
    index = f"# Examples\n\n{_INTRODUCTION}\n\n" + "\n".join(links) + "\n"
    return {f"{FOLDER}/index.md": index, **pages}


_INTRODUCTION = """\
Scripts and notebooks on data that they simulate themselves in seconds. All of them lie in
`examples/` of the repository, and all of them are run by the tests."""


def _script(file: Path) -> str:
    text = file.read_text(encoding="utf-8")
    docstring = ast.get_docstring(ast.parse(text)) or ""
    title, _, rest = docstring.partition("\n")
    code = text.split('"""', 2)[2].strip()
    return (
        f"# {title.rstrip('.')}\n\n{rest.strip()}\n\n"
        f'```python title="examples/{file.name}"\n{code}\n```\n\n'
        f"It prints (`...` stands for more):\n\n```text\n{printed_by(file)}```\n"
    )


def printed_by(file: Path) -> str:
    """What a script prints, from the text file beside it; ``...`` stands for more."""
    return file.with_suffix(".txt").read_text(encoding="utf-8")


def _notebook(file: Path) -> Iterator[str]:
    for each in json.loads(file.read_text(encoding="utf-8"))["cells"]:
        source = "".join(each["source"])
        yield source if each["cell_type"] == "markdown" else f"```python\n{source}\n```"
