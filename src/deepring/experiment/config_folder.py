"""Where the configs lie."""

from pathlib import Path


def config_folder() -> Path:
    """The packaged ``conf/``, or the checkout's where the package runs from one."""
    package = Path(__file__).resolve().parents[1]
    packaged = package / "conf"
    return packaged if packaged.is_dir() else package.parents[1] / "conf"
