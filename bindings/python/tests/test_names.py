"""Another project's package of the same name is detected."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import umo


def imported(folder, module):
    """The message of a new interpreter, without this one's folders, on importing a module in the folder."""
    code = f"import sys; sys.path.insert(0, {str(folder)!r}); import {module}"
    return subprocess.run([sys.executable, "-I", "-c", code], capture_output=True, text=True)


@pytest.mark.parametrize("left", ["# of another project\n", None], ids=["replaced", "removed"])
@pytest.mark.parametrize("module", ["umo.agents", "umo._motion"])
def test_a_package_of_another_project_is_refused(tmp_path, left, module):
    ours = Path(umo.__file__).parent
    shutil.copytree(ours, tmp_path / "umo")
    init = tmp_path / "umo/__init__.py"
    if left is None:
        init.unlink()
    else:
        init.write_text(left)
    run = imported(tmp_path, module)
    assert run.returncode == 1
    last = run.stderr.strip().splitlines()[-1]
    assert last.startswith("ImportError: the module umo is not that of umo-avatar") and "pip uninstall umo" in last
