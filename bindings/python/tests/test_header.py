"""The package's declarations of the C interface match umo.h."""

import re

import pytest

import umo
from umo import _library, _session


@pytest.fixture(scope="module")
def header(prefix):
    text = (prefix / "include/umo.h").read_text("utf-8")
    return re.sub(r"//.*", "", text)


def test_every_function_is_declared_and_no_other(header):
    functions = set(re.findall(r"\b(umo_\w+)\(", header))
    assert set(_library._ARGUMENTS) <= functions
    # numpy's layouts are built from the library's own and need no check; a Motion outlives its model, and has its own
    # file writer.
    unused = {"umo_frame_layout_check", "umo_clip_init", "umo_clip_write_file"}
    assert functions - set(_library._ARGUMENTS) <= unused


def test_every_parameter_of_the_library_is_a_property():
    listed = {info.name.decode(): (info.id, info.minimum, info.maximum) for info in _session._parameters()}
    mine = {name: (p.id, p.minimum, p.maximum) for name, p in umo.Session.parameters().items()}
    assert mine == listed
