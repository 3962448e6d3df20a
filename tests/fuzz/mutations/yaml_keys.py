"""YAML files with other values at their keys, and YAML's own traps."""

from random import Random

from fuzz.files import Files, Mutation
from fuzz.mutations.values import VALUES

_TEXTS = (
    *(
        "",
        "~",
        "yes",
        "no",
        "on",
        "2024-01-01",
        "0x1F",
        "017",
        "1_000",
        "1e3",
        ".5",
        ".nan",
        ".inf",
    ),
    *("-.inf", "*missing", "&a [*a]", "!!python/object/apply:os.system ['true']", "!!binary aGk="),
    *("<<: {a: 1}", "'1.8'", '"\\x1b[31m"', "[1, 2", "{a: b", "- x", "[z]", "-z", "-y", "sensor"),
    *(
        "kitti",
        "mulran",
        "nclt",
        "tum",
        "../..",
        "/dev/zero",
        "/",
        ".",
        "scans/",
        "./scans",
        "$HOME",
    ),
    *("${oc.env:HOME}", "${scans}", "???", "[-1e400, 3]", "[3, -1]", "[0, 400]", "[1]", "[a, b]"),
    *(
        "!!float 'x'",
        "!!int '9e9'",
        "!!timestamp 'x'",
        "? x",
        "|\n  x",
        "[[[[[[1]]]]]]",
        "1" * 5000,
    ),
)


def _laughs(levels: int) -> str:
    """Aliases of aliases: a few lines that stand for ten to the power of ``levels`` values."""
    rows = ["&a0 [0, 0, 0, 0, 0, 0, 0, 0, 0, 0]"]
    for k in range(1, levels):
        rows.append(f"&a{k} [{', '.join(10 * [f'*a{k - 1}'])}]")
    return f"[{', '.join(rows)}]"


def yaml_keys(name: str) -> Mutation:
    """One to three keys with other values, twice, missing or misspelt."""

    def mutate(rng: Random, files: Files) -> str:
        lines = files[name].decode().rstrip("\n").split("\n")
        done = []
        for _ in range(rng.choice((1, 1, 2, 3))):
            k = rng.randrange(len(lines))
            key = lines[k].partition(":")[0]
            kind = rng.randrange(8)
            if kind == 0 and len(lines) > 1:
                del lines[k]
                done.append(f"without {key}")
            elif kind == 1:
                lines.insert(rng.randrange(len(lines) + 1), lines[k])
                done.append(f"{key} twice")
            elif kind == 2:
                new = rng.choice((key.upper(), f"{key}s", f" {key}", "drives", "name", "<<", "7"))
                lines[k] = new + lines[k][len(key) :]
                done.append(f"{key} as {new}")
            elif kind == 3:
                value = rng.choice(
                    [v for v in VALUES if v is None or isinstance(v, int | float | str)]
                )
                lines[k] = f"{key}: {value!r}"
                done.append(lines[k][:50])
            elif kind == 4 and rng.random() < 0.2:
                lines[k] = f"{key}: {_laughs(rng.choice((3, 8)))}"
                done.append(f"{key} of aliases")
            elif kind == 4 and rng.random() < 0.1:
                lines[k] = f"{key}: " + "[" * 3000 + "]" * 3000
                done.append(f"{key} nested deeply")
            else:
                lines[k] = f"{key}: {rng.choice(_TEXTS)}"
                done.append(lines[k][:50])
        files[name] = ("\n".join(lines) + "\n").encode("utf-8", "surrogatepass")
        return f"{name}: {', '.join(done)}"

    return mutate
