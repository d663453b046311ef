"""Conan 2 recipe for this repository: conan create packaging/conan [-o "umo/*:shared=True"]."""

import re
from pathlib import Path

from conan import ConanFile
from conan.errors import ConanInvalidConfiguration
from conan.tools.build import cross_building
from conan.tools.files import copy, rm

ROOT = Path(__file__).resolve().parents[2]


class Umo(ConanFile):
    name = "umo"
    description = "Speech to a living avatar: face, hands and body at 30 frames a second, on the CPU"
    license = "MIT OR Apache-2.0"
    topics = ("avatar", "animation", "speech", "lip-sync")
    package_type = "library"
    settings = "os", "arch", "compiler", "build_type"
    options = {"shared": [True, False]}
    default_options = {"shared": True}

    def set_version(self):
        self.version = re.search(r'^version = "([^"]+)"$', (ROOT / "Cargo.toml").read_text("utf-8"), re.MULTILINE)[1]

    def export_sources(self):
        # Files that Cargo and scripts/build/install read: the whole workspace without build outputs and git data.
        excludes = (".git/*", "target/*", "*/target/*", "examples/build/*", "packaging/*/build/*", "docs/*", "training/*", "benches/results/*")
        copy(self, "*", src=str(ROOT), dst=self.export_sources_folder, excludes=excludes)

    def validate(self):
        if cross_building(self):
            raise ConanInvalidConfiguration("scripts/build/install builds for the machine that it runs on")
        if self.settings.os == "Windows" and not self.options.shared:
            raise ConanInvalidConfiguration("scripts/build/install lays out no static library on Windows")

    def package_id(self):
        # Built by Rust, always optimised, with a C interface: the same for every compiler and build type.
        del self.info.settings.compiler
        del self.info.settings.build_type

    def package(self):
        # Built here, since scripts/build/install builds and installs in one step.
        self.run(f'bash scripts/build/install --prefix "{self.package_folder}"', cwd=self.build_folder)
        libraries = Path(self.package_folder) / "lib"
        if self.options.shared:
            rm(self, "libumo.a", str(libraries))
        else:
            rm(self, "libumo*.so*", str(libraries))
            rm(self, "libumo*.dylib", str(libraries))
        licences = Path(self.package_folder) / "share/licenses/umo"
        copy(self, "*", src=str(licences), dst=str(Path(self.package_folder) / "licenses"))

    def package_info(self):
        # Use umo's own CMake package: it has the same targets and umo_MODEL_DIR from every source.
        self.cpp_info.set_property("cmake_find_mode", "none")
        self.cpp_info.builddirs = ["lib/cmake/umo"]
        self.cpp_info.set_property("pkg_config_name", "umo")
        self.cpp_info.set_property("pkg_config_custom_content", "modeldir=${prefix}/share/umo/models")
        self.cpp_info.resdirs = ["share/umo"]
        self.cpp_info.libs = ["umo.dll" if self.settings.os == "Windows" else "umo"]
        if not self.options.shared:
            self.cpp_info.defines = ["UMO_STATIC"]
            if self.settings.os in ("Linux", "FreeBSD", "Android"):
                self.cpp_info.system_libs = ["pthread", "dl", "m"]
