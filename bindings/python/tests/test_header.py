"""The package's declarations of the C interface match umo.h."""

import ctypes
import re
import subprocess

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


def test_structures_lie_as_the_compiler_lays_them(prefix, tmp_path):
    lines, expected = [], []
    for name, kind in _library.STRUCTURES.items():
        lines.append(f'printf("%zu\\n", sizeof({name}));')
        expected.append(ctypes.sizeof(kind))
        for field, _ in kind._fields_:
            lines.append(f'printf("%zu\\n", offsetof({name}, {field}));')
            expected.append(getattr(kind, field).offset)
            lines.append(f'printf("%zu\\n", sizeof((({name} *)0)->{field}));')
            expected.append(getattr(kind, field).size)
    assert run_c(prefix, tmp_path, lines) == expected


def test_constants_are_the_header_s(prefix, tmp_path):
    names = {f"UMO_STATUS_{status.name}": int(status) for status in umo.Status}
    names |= {f"UMO_IDLE_{idle.name}": int(idle) for idle in umo.Idle}
    names |= {f"UMO_ATTENTION_{state.name}": int(state) for state in umo.Attention}
    for group in ("PARAMETERS", "AXES", "PRECISIONS", "ISAS", "FORMATS", "MOODS", "VOICES", "PACKETS", "SIDES", "GESTURE_PARTS"):
        stem = {"AXES": "AXES", "PACKETS": "PACKETS", "GESTURE_PARTS": "GESTURE"}.get(group, group[:-1])
        names |= {f"UMO_{stem}_{name.upper()}": value for name, value in getattr(_library, group).items()}
    for name in ("ABI_VERSION", "ABSENT", "JOINT_COUNT", "VISEME_COUNT", "ERROR_SIZE", "ENGINE_THREADS", "ENGINE_POLLED"):
        names[f"UMO_{name}"] = getattr(_library, name)
    for name in ("MODEL_NAME", "MODEL_LICENSE", "MODEL_NOTICE", "MODEL_ISA", "PARAMETER_WHOLE"):
        names[f"UMO_{name}"] = getattr(_library, name)
    assert run_c(prefix, tmp_path, [f'printf("%lld\\n", (long long){name});' for name in names]) == list(names.values())


def test_every_constant_is_known(header):
    known = {f"UMO_STATUS_{status.name}" for status in umo.Status} | {f"UMO_IDLE_{idle.name}" for idle in umo.Idle}
    known |= {f"UMO_ATTENTION_{state.name}" for state in umo.Attention}
    known |= {f"UMO_PARAMETER_{name.upper()}" for name in umo.Session.parameters()}
    known |= {f"UMO_MOOD_{name.upper()}" for name in _library.MOODS} | {f"UMO_VOICE_{name.upper()}" for name in _library.VOICES}
    known |= {f"UMO_SIDE_{name.upper()}" for name in _library.SIDES}
    known |= {f"UMO_PACKETS_{name.upper()}" for name in _library.PACKETS}
    known |= {f"UMO_GESTURE_{name.upper()}" for name in _library.GESTURE_PARTS}
    known |= {f"UMO_FORMAT_{name.upper()}" for name in _library.FORMATS}
    used = ("FORMAT", "STATUS", "IDLE", "PARAMETER", "ATTENTION", "MOOD", "VOICE", "PACKETS", "SIDE", "GESTURE")
    found = {name for name in re.findall(r"#define (UMO_\w+)", header) if name.split("_")[1] in used}
    assert found - known == {"UMO_PARAMETER_WHOLE"}


def test_every_parameter_of_the_library_is_a_property():
    listed = {info.name.decode(): (info.id, info.minimum, info.maximum) for info in _session._parameters()}
    mine = {name: (p.id, p.minimum, p.maximum) for name, p in umo.Session.parameters().items()}
    assert mine == listed


def run_c(prefix, tmp_path, lines):
    source = tmp_path / "program.c"
    source.write_text("#include <stdio.h>\n#include <umo.h>\nint main(void) {\n" + "\n".join(lines) + "\nreturn 0;\n}\n")
    program = tmp_path / "program"
    subprocess.run(["cc", "-I", prefix / "include", "-o", program, source], check=True)
    return [int(line) for line in subprocess.run([program], check=True, capture_output=True, text=True).stdout.split()]
