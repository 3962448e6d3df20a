"""Pages of the public names of the package, for mkdocstrings to fill with their docstrings."""

import importlib

FOLDER = "reference/python"

#: What contributors build on, beside the public names: module, and its names.
_EXTENDING = {
    "deepring.methods.method": ("Method", "Comparison", "index_of"),
    "deepring.methods.registry": ("register_method",),
    "deepring.methods.network": ("NetworkMethod", "PlainSettings"),
    "deepring.rasters": ("Raster", "PolarRaster", "make_raster"),
    "deepring.localization.map_building": ("build_map",),
    "deepring.training.scheme": ("TrainingScheme",),
}


def api_pages() -> dict[str, str]:
    """The Markdown of the pages by path: one for each room of the package with public names."""
    import deepring

    rooms: dict[str, list[str]] = {}
    for name, module in deepring._MODULES.items():
        rooms.setdefault(module.split(".")[1], []).append(f"{module}.{name}")
    pages = {
        room: _page(f"deepring.{room}", sorted(names)) for room, names in sorted(rooms.items())
    }
    pages["extending"] = _extending()
    links = [
        f"- [{text.splitlines()[0][2:]}]({name}.md): "
        + ", ".join(
            f"`{line.rpartition('.')[2]}`" for line in text.splitlines() if line.startswith(":::")
        )
        for name, text in pages.items()
    ]
    index = (
        "# Python\n\n`from deepring import NAME` has the names below, but those for extending the "
        "package, which are imported from where their pages say. [One line for each](../../api.md)."
        "\n\n"
    )
    return {
        f"{FOLDER}/index.md": index + "\n".join(links) + "\n",
        **{f"{FOLDER}/{name}.md": text for name, text in pages.items()},
    }


def _page(room: str, paths: list[str]) -> str:
    summary = (importlib.import_module(room).__doc__ or "").strip().splitlines()[0]
    blocks = "\n\n".join(f"::: {path}" for path in paths)
    return f"# {room}\n\n{summary}\n\n{blocks}\n"


def _extending() -> str:
    paths = [f"{module}.{name}" for module, names in _EXTENDING.items() for name in names]
    blocks = "\n\n".join(
        f"::: {path}\n    options:\n      show_root_full_path: true" for path in paths
    )
    about = "What a method, a raster or a training scheme of your own builds on."
    return f"# Extending the package\n\n{about}\n\n{blocks}\n"
