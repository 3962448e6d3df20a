"""Changes to plain values, as JSON holds them: other types, other sizes, extremes, other keys."""

import copy
import json
import math
from random import Random
from typing import Any

#: Values of all types, and extremes of each.
VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, 1, -1, 2, 3, 7, 64, 255, 10**5, 2**31, 2**53 + 1, 2**63, 2**64, 10**30),
    *(10**400, 0.0, -0.0, 0.5, 1.5, -3.25, 1e-300, 1e300, float("nan"), float("inf")),
    *(-float("inf"), "", " ", "x", "7", "nan", "null", "x" * 5000, "\x1b[31mred", "a\nb", "\0"),
    *("../../../etc/passwd", "/dev/zero", "<script>alert(1)</script>", "os.system", "\ud800"),
    *(
        "deepring.methods.deepring.DeepRing",
        "float16",
        "int8",
        [],
        {},
        [[]],
        {"": None},
        [0],
        [1, 2],
    ),
    *([1, 2, 3], [None], ["x"], {"a": 1}, [float("nan")] * 3, [1] * 1000, {"kind": "x"}),
)

#: JSON that no value can be made of without trouble, by the texts that stand for it.
_TEXTS = {
    "@nested@": "[" * 5000 + "]" * 5000,
    "@objects@": '{"a":' * 3000 + "0" + "}" * 3000,
    "@digits@": "9" * 5000,
    "@somewhat nested@": "[" * 40 + "]" * 40,
}


def as_json(value: Any) -> str:
    """The JSON text of a changed value."""
    text = json.dumps(value)
    for name, new in _TEXTS.items():
        text = text.replace(f'"{name}"', new)
    return text


#: Other numbers of the same type; those of a schema are often plausible.
_INTEGERS = (0, 1, -1, 2, 3, 5, 7, 16, 63, 100, 4096, 10**6, 2**31 - 1, 2**31, 2**40, 2**63 - 1)
_FLOATS = (
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    1e-9,
    1e-300,
    1e9,
    1e38,
    1e300,
    360.0,
    float("nan"),
    float("inf"),
)


def changed(rng: Random, value: Any) -> tuple[Any, str]:
    """A copy with one to three changes, and what they were."""
    whole = {"": copy.deepcopy(value)}
    done = [_change(rng, whole) for _ in range(rng.choice((1, 1, 1, 1, 2, 3)))]
    return whole.get(""), ", ".join(done)


def _place(rng: Random, whole: dict[str, Any]) -> tuple[Any, Any]:
    """A container within, and one of its keys: any branch is as likely as the others."""
    container: Any = whole
    while True:
        key = rng.choice(list(container) if isinstance(container, dict) else range(len(container)))
        inner = container[key]
        is_leaf = not isinstance(inner, dict | list) or not inner
        if is_leaf or (container is not whole and rng.random() < 0.15):
            return container, key
        container = inner


def _change(rng: Random, whole: dict[str, Any]) -> str:
    if "" not in whole or not isinstance(whole[""], dict | list) or not whole[""]:
        whole[""] = rng.choice(VALUES)
        return "another value"
    container, key = _place(rng, whole)
    old = container[key]
    if rng.random() < 0.55:
        new = _of_its_type(rng, old)
        if new is not None:
            container[key] = new
            return f"{key!r} {str(new)[:20]}"
    return _of_any_type(rng, whole, container, key)


def _of_its_type(rng: Random, old: Any) -> Any:
    """Another value of the same type, or None."""
    if isinstance(old, bool):
        return not old
    if isinstance(old, int):
        return rng.choice((*_INTEGERS, old + 1, old - 1, -old, old * 2, old // 2, old + 1, old * 2))
    if isinstance(old, float):
        return rng.choice((*_FLOATS, -old, old * 2, old / 2, old * 1000, old + 1))
    if isinstance(old, str):
        words = ("none", "zero", "batch", "instance", "mean", "max", "linear", "pose", "bev", "gem")
        return rng.choice((old + "x", old[:-1], old.upper(), *words))
    if isinstance(old, list) and old:
        return rng.choice((old[::-1], old[:-1], [*old, old[0]], old * 3, [old[0]] * len(old)))
    return None


def _as_float(value: float) -> float:
    """The value as a float; infinite for integers beyond all floats, as an earlier change makes."""
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _of_any_type(rng: Random, whole: dict[str, Any], container: Any, key: Any) -> str:
    old, kind = container[key], rng.randrange(9)
    if kind == 0:
        del container[key]
        return f"without {key!r}"
    if kind == 1 and isinstance(container, dict):
        container[rng.choice(("unknown", "", "kind", f"{key}2", "\x1b[31m"))] = old
        return f"a further key beside {key!r}"
    if kind == 2 and isinstance(container, list):
        container.insert(key, copy.deepcopy(old))
        return f"one more at {key!r}"
    if kind == 3:
        other, name = _place(rng, whole)
        container[key] = copy.deepcopy(other[name])
        return f"{key!r} as {name!r}"
    if kind == 4 and isinstance(old, int | float):
        container[key] = rng.choice((_as_float(old), str(old), [old], old == 1))
        return f"{key!r} as another type"
    if kind == 5:
        container[key] = [old] if rng.random() < 0.5 else {"": old}
        return f"{key!r} within another"
    if kind == 6 and rng.random() < 0.4:
        container[key] = rng.choice(list(_TEXTS))
        return f"{key!r} {container[key]}"
    container[key] = copy.deepcopy(rng.choice(VALUES))
    return f"{key!r} {str(container[key])[:20]!a}"
