"""Origin of a measurement: processor, commit, date."""

import datetime
import pathlib
import re
import subprocess

ROOT = pathlib.Path(__file__).resolve().parent.parent
# Paths of the measured programs.
PROGRAMS = ["kernels", "umo-core", "cli", "models", "benches/polls.rs"]

# Hosts hide AMD processor names: identify them by family and model.
ZEN = {("25", "1"): "Zen 3", ("25", "17"): "Zen 4", ("25", "160"): "Zen 4", ("26", "2"): "Zen 5", ("26", "17"): "Zen 5"}


def processor():
    info = pathlib.Path("/proc/cpuinfo")
    found = dict(re.findall(r"^([a-z ]+?)\s*: (.*)$", info.read_text(), re.M)) if info.exists() else {}
    name = found.get("model name", "unknown processor")
    zen = ZEN.get((found.get("cpu family"), found.get("model"))) if name == "AMD EPYC" else None
    return f"{name} ({zen})" if zen else name


def git(*words):
    return subprocess.run(["git", "-C", ROOT, *words], check=True, capture_output=True, text=True).stdout.strip()


def commit():
    """The commit, with a mark if the programs have uncommitted changes."""
    return git("describe", "--always") + ("-dirty" if git("status", "--short", "--", *PROGRAMS) else "")


def origin():
    return {"processor": processor(), "date": datetime.date.today().isoformat(), "commit": commit()}
