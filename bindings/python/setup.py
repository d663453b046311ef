"""Builds the wheel: the package with libumo, the default model and the licences of both, as scripts/build/install lays them out.

UMO_PREFIX names a folder that scripts/build/install made; where it is not set, scripts/build/install makes one.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from setuptools import setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py
from setuptools.dist import Distribution
from setuptools.errors import SetupError

ROOT = Path(__file__).resolve().parents[2]


def repository() -> Path:
    if not (ROOT / "scripts/build/install").is_file():
        raise SetupError("umo's wheel is built inside umo's repository: pip install ./bindings/python")
    return ROOT


def workspace(key: str) -> str:
    """A text from Cargo.toml's workspace package."""
    text = (repository() / "Cargo.toml").read_text("utf-8")
    return re.search(rf'^{key} = "(.*)"$', text, re.MULTILINE)[1]


def library(prefix: Path) -> Path:
    """The shared library of an installation."""
    file = prefix / {"win32": "bin/umo.dll", "darwin": "lib/libumo.dylib"}.get(sys.platform, "lib/libumo.so")
    if not file.is_file():
        raise SetupError(f"{file} is missing: {prefix} was not made by scripts/build/install")
    return file


class BuildWithLibrary(build_py):
    """Adds libumo, the model and the licences to the package."""

    def run(self):
        super().run()
        # An editable install uses the package in place.
        package = ROOT / "bindings/python/src/umo" if self.editable_mode else Path(self.build_lib) / "umo"
        given = os.environ.get("UMO_PREFIX")
        if given:
            self.bundle(Path(given), package)
            return
        with tempfile.TemporaryDirectory() as prefix:
            # Through bash: Windows does not start scripts by their first line.
            subprocess.run(["bash", str(repository() / "scripts/build/install"), "--prefix", prefix], check=True)
            self.bundle(Path(prefix), package)

    def bundle(self, prefix, package):
        (package / "licenses").mkdir(parents=True, exist_ok=True)
        shutil.copyfile(library(prefix), package / library(prefix).name)
        for name in ("umo-people.safetensors", "umo-people.md"):
            shutil.copyfile(prefix / "share/umo/models" / name, package / name)
        for file in (prefix / "share/licenses/umo").iterdir():
            shutil.copyfile(file, package / "licenses" / file.name)


class WheelOfPlatform(bdist_wheel):
    """One wheel for every Python version: the library is loaded with ctypes and independent of it."""

    def get_tag(self):
        return "py3", "none", super().get_tag()[2]


class WithLibrary(Distribution):
    def has_ext_modules(self):
        return True


ADDRESS = workspace("repository")
setup(
    version=workspace("version"),
    project_urls={"Repository": ADDRESS} if ADDRESS else {},
    distclass=WithLibrary,
    cmdclass={"build_py": BuildWithLibrary, "bdist_wheel": WheelOfPlatform},
)
