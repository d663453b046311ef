"""The README's programs run."""

import re
import subprocess
import sys
import warnings

import pytest

from conftest import ROOT

HERE = ROOT / "bindings/python"


def test_the_readme_s_programs_run(monkeypatch, model, tmp_path):
    programs = re.findall(r"^```python\n(.*?)^```$", (HERE / "README.md").read_text("utf-8"), re.MULTILINE | re.DOTALL)
    assert len(programs) == 3
    # They read assets and write files.
    monkeypatch.chdir(tmp_path)
    (tmp_path / "assets").symlink_to(ROOT / "assets")
    names = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        # One after the other: each continues where the previous one ended.
        for program in programs:
            exec(compile(program, "README.md", "exec"), names)
    assert sorted(file.name for file in tmp_path.glob("hello.*")) == ["hello.bvh", "hello.csv", "hello.glb", "hello.jsonl", "hello.npz", "hello.vrma"]
    assert names["frame"].index == 228 and names["pose"].rotations.shape == (55, 4)


def test_the_example_draws_the_jaw(tmp_path):
    pytest.importorskip("matplotlib")
    picture = tmp_path / "jaw.png"
    command = [sys.executable, HERE / "examples/plot_jaw.py", ROOT / "assets/hello.wav", picture]
    subprocess.run(command, check=True, capture_output=True)
    assert picture.read_bytes().startswith(b"\x89PNG") and picture.stat().st_size > 10_000
