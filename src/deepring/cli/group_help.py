"""`deepring train --help`: what can be chosen, without importing what composes and runs it."""

from pathlib import Path
from textwrap import wrap

from deepring.experiment.config_groups import chosen_options, group_options

_USAGE = """\
usage: deepring {command} [GROUP=OPTION ...] [KEY=VALUE ...]

{about}

  GROUP=OPTION   a choice from a group below; ~GROUP for none; test=[A,B] for several
  KEY=VALUE      any single value, such as data.root=FOLDER or {example}
  --cfg job      print every key with its value, and stop
  --hydra-help   the flags of Hydra, which composes the config
"""
_ABOUT = {
    "train": "Train a method and evaluate it. With -m: once for each value of what is given "
    "several, such as seed=0,1,2; a sweep that was stopped goes on.",
    "evaluate": "Evaluate methods on a test region: those that learn nothing, and the trained "
    "network of checkpoint=FILE.",
}
_EXAMPLES = {"train": "method.encoder.stem=2", "evaluate": "evaluation.radii=[10,25]"}

#: Columns of the terminal that the options of a group are wrapped to.
_WIDTH = 100


def group_help(command: str, folder: Path) -> str:
    """The help of ``deepring train`` or ``deepring evaluate``: groups, options and defaults."""
    chosen, options = chosen_options(folder, command), group_options(folder)
    # What belongs to a method can be chosen wherever the method can.
    groups = [group for group in options if group.partition("/")[0] in chosen]
    width = max(map(len, groups)) + 2
    lines = []
    for group in groups:
        names = [f"{name}*" if name == chosen.get(group) else name for name in options[group]]
        first, *rest = wrap(" ".join(names), _WIDTH - width - 2, break_long_words=False)
        lines += [f"  {group:<{width}}{first}", *(f"  {'':<{width}}{line}" for line in rest)]
    about = "\n".join(wrap(_ABOUT[command], _WIDTH))
    flags = " [-m]" if command == "train" else ""
    usage = _USAGE.format(command=command + flags, about=about, example=_EXAMPLES[command])
    return "\n".join([usage, "groups and their options (* by default):", *lines, ""])
