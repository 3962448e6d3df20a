"""The structure of the package in numbers: lines, types, names, imports, and walks through it.

    python benchmarks/structure.py [CHECKOUT]
    python benchmarks/structure.py --within evaluate --walk evaluate checkpoint=shipped ...

The first counts what stands in the source of a checkout. The second runs a `deepring` command in
this process and counts the files of the package whose code is run on the way, and the containers
(dataclasses and named tuples of the package) that are made; with ``--within`` only while a function
of that name is at work.
"""

import argparse
import ast
import sys
import threading
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType
from typing import Any


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("checkout", type=Path, nargs="?", default=Path(__file__).parents[1])
    parser.add_argument("--within", metavar="FUNCTION", help="of the package, for --walk")
    parser.add_argument("--walk", nargs=argparse.REMAINDER, help="a command of deepring")
    args = parser.parse_args(arguments)
    rows = walk(args.walk, args.within) if args.walk else count(args.checkout)
    for name, value in rows.items():
        print(f"{name:<44} {value}")


def count(checkout: Path) -> dict[str, Any]:
    """What stands in the source."""
    package = checkout / "src" / "deepring"
    sources = {path: ast.parse(path.read_text()) for path in sorted(package.rglob("*.py"))}
    classes = [node for tree in sources.values() for node in tree.body if is_class(node)]
    public = [node.name for node in classes if not node.name.startswith("_")]
    files = Counter(path.stem for path in sources if path.stem != "__init__")
    names = Counter(node.name for node in classes)
    return {
        "files": len(sources),
        "lines": sum(len(path.read_text().splitlines()) for path in sources),
        "public types": len(public),
        "containers (dataclasses, named tuples)": sum(map(is_container, classes)),
        "class names used more than once": named_twice(names),
        "file names used more than once": named_twice(files),
        "rooms": len(
            {path.relative_to(package).parts[0] for path in sources if path.parent != package}
        ),
        "import arrows between rooms": len(arrows(package, sources)),
        "import arrows between files": len(arrows(package, sources, files=True)),
        "yaml files": len(list((checkout / "conf").rglob("*.yaml"))),
        "lines of yaml": sum(
            len(p.read_text().splitlines()) for p in (checkout / "conf").rglob("*.yaml")
        ),
    }


def is_class(node: ast.stmt) -> bool:
    return isinstance(node, ast.ClassDef)


def is_container(node: ast.ClassDef) -> bool:
    """Whether a class is a dataclass or a named tuple."""
    marks = [ast.unparse(mark) for mark in (*node.decorator_list, *node.bases)]
    return any(mark.startswith(("dataclass", "NamedTuple")) for mark in marks)


def named_twice(names: Counter[str]) -> str:
    twice = sorted(name for name, number in names.items() if number > 1)
    return f"{len(twice)} ({', '.join(twice)})" if twice else "0"


def arrows(package: Path, sources: dict[Path, ast.Module], *, files: bool = False) -> set[Any]:
    """Pairs of rooms, or of files, of which the first imports from the second."""
    pairs = set()
    for path, tree in sources.items():
        here = ".".join(path.relative_to(package).with_suffix("").parts)
        for node in ast.walk(tree):
            if not isinstance(node, ast.ImportFrom) or not (node.module or "").startswith(
                "deepring."
            ):
                continue
            there = (node.module or "").removeprefix("deepring.")
            first, second = (here, there) if files else (here.split(".")[0], there.split(".")[0])
            if first != second:
                pairs.add((first, second))
    return pairs


def walk(command: Sequence[str], within: str | None) -> dict[str, Any]:
    """Files and containers of the package that a command passes, within a function or whole."""
    import deepring
    from deepring.cli.main import main as run

    package = str(Path(deepring.__file__).parent)
    files: set[str] = set()
    containers: set[str] = set()

    inside = 0 if within else 1

    def note(frame: FrameType, event: str, _: Any) -> None:
        nonlocal inside
        code = frame.f_code
        if code.co_name == within and code.co_filename.startswith(package):
            inside += {"call": 1, "return": -1}.get(event, 0)
        if event != "call" or not inside:
            return
        if code.co_filename.startswith(package) and code.co_name != "<module>":
            files.add(code.co_filename.removeprefix(package + "/"))
        if code.co_filename.startswith("<") and code.co_name in ("__init__", "__new__", "<lambda>"):
            made = frame.f_locals.get("self", frame.f_locals.get("_cls"))
            kind = made if isinstance(made, type) else type(made)
            if kind.__module__.startswith("deepring"):
                containers.add(kind.__qualname__)

    traced(note, lambda: run(list(command)))
    print(*sorted(files), sep="\n")
    print(*sorted(containers), sep=", ")
    return {"files": len(files), "containers": len(containers)}


def traced(note: Callable[..., None], work: Callable[[], None]) -> None:
    threading.setprofile(note)
    sys.setprofile(note)
    try:
        work()
    except SystemExit:
        pass
    finally:
        sys.setprofile(None)
        threading.setprofile(None)


if __name__ == "__main__":
    main()
