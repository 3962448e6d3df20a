"""An empty environment: made, filled, used without anything of the caller's, and deleted."""

import os
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

#: Packages whose versions decide most.
_TOLD = ("torch", "numpy", "numba", "scipy", "lightning")

#: Wheels alone: a user has no compiler. The one package without wheels is plain Python.
_WHEELS = ("--only-binary", ":all:", "--no-binary", "antlr4-python3-runtime")


class CommandError(Exception):
    """A command failed or printed a warning of Python; the text is the command and its output."""


class Environment:
    """A virtual environment in a folder; commands run in ``work``, an empty folder beside it."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.work = folder / "venv", folder / "work"
        self.work.mkdir(parents=True)

    @property
    def python(self) -> Path:
        """The interpreter."""
        return self.folder / "bin" / "python"

    def make(self, interpreter: Path) -> None:
        """Make it with the newest pip, which finds old versions that go together in less time."""
        _run([str(interpreter), "-m", "venv", str(self.folder)], self.work)
        self.run("-m", "pip", "install", "--quiet", "--upgrade", "pip", keep=("PIP_",))

    def copy(self, other: "Environment") -> None:
        """Take over the packages of another, and what was made in it.

        The files of packages are shared: pip replaces files and never writes into them. Scripts
        name the interpreter that runs them, so they are written anew.
        """
        shutil.copytree(other.folder, self.folder, symlinks=True, copy_function=os.link)
        named = f"#!{other.python}\n".encode()
        for script in (self.folder / "bin").iterdir():
            if not script.is_symlink() and (content := script.read_bytes()).startswith(named):
                mode = script.stat().st_mode
                script.unlink()
                script.write_bytes(f"#!{self.python}\n".encode() + content[len(named) :])
                script.chmod(mode)
        shutil.copytree(other.work, self.work, symlinks=True, dirs_exist_ok=True)

    def install(self, *packages: str, constraints: Path | None = None) -> None:
        """Install packages with pip, as the machine's pip is configured."""
        options = [] if constraints is None else ["-c", str(constraints)]
        self.run("-m", "pip", "install", "--quiet", *_WHEELS, *options, *packages, keep=("PIP_",))
        self.run("-m", "pip", "check")

    def run(
        self,
        *arguments: str,
        cwd: Path | None = None,
        keep: Sequence[str] = (),
        variables: Mapping[str, str] | None = None,
    ) -> str:
        """Run the interpreter with arguments; returns what it printed. Raises CommandError.

        Of the caller's variables it has the language, those of the proxy, those that tell OpenBLAS
        about the processor, and those that begin with one of ``keep``; ``variables`` are further
        ones.
        """
        kept = ("LANG", "LC_", "http", "HTTP", "SSL", "REQUESTS", "OPENBLAS_", *keep)
        given = {name: value for name, value in os.environ.items() if name.startswith(kept)}
        given["PATH"] = f"{self.folder / 'bin'}:/usr/bin:/bin"
        given["HOME"] = os.environ.get("HOME", "") if "PIP_" in keep else str(self.work)
        given.update(variables or {})
        return _run([str(self.python), *arguments], cwd or self.work, given)

    def deepring(self, *arguments: str) -> str:
        """Run the command line; returns what it printed."""
        return self.run("-m", "deepring", *arguments)

    def versions(self) -> str:
        """The versions of what decides most."""
        listed = self.run("-m", "pip", "list", "--format=freeze").splitlines()
        found = dict(line.split("==", 1) for line in listed if "==" in line)
        return ", ".join(f"{name} {found[name]}" for name in _TOLD if name in found)

    def delete(self) -> None:
        """Delete the environment and what was made in it."""
        shutil.rmtree(self.folder.parent, ignore_errors=True)


def _run(command: Sequence[str], cwd: Path, variables: Mapping[str, str] | None = None) -> str:
    done = subprocess.run(
        command, cwd=cwd, env=variables, capture_output=True, text=True, check=False
    )
    if done.returncode or "Warning: " in done.stderr:
        shown = " ".join(command[1:] if len(command) < 30 else [*command[1:30], "..."])
        raise CommandError(f"{shown}\n{done.stdout[-2000:]}{done.stderr[-3000:]}")
    return done.stdout
