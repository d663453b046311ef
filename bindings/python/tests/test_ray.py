"""Recordings over the workers of a Ray cluster on this machine."""

import json
import os
import signal
import threading
import time
import wave

import numpy as np
import pytest

import umo

pytest.importorskip("ray", reason="the package ray is not installed: bindings/python/setup installs it")

import ray

import umo.ray

pytestmark = pytest.mark.filterwarnings("default")
WORKERS = 3


@pytest.fixture(scope="module")
def cluster():
    # Ray's workers otherwise lower their priority, and would stall on a busy machine.
    os.environ["RAY_worker_niceness"] = "0"
    ray.init(num_cpus=WORKERS, include_dashboard=False, log_to_driver=False, object_store_memory=100 << 20)
    ray.data.DataContext.get_current().enable_progress_bars = False
    yield
    ray.shutdown()


@pytest.fixture
def lines(hello, tmp_path):
    """Files with a second and a half of speech each, all different."""
    samples, rate = hello
    paths = []
    for number in range(12):
        path = tmp_path / "speech" / f"line{number:02d}.wav"
        path.parent.mkdir(exist_ok=True)
        with wave.open(str(path), "wb") as file:
            file.setparams((1, 2, rate, 0, "NONE", ""))
            file.writeframes(samples[number * 8000 : number * 8000 + 24000].tobytes())
        paths.append(path)
    return paths


def workers():
    """Processes of this cluster's actors."""
    parents, found = {}, []
    for name in os.listdir("/proc"):
        if not name.isdigit():
            continue
        try:
            with open(f"/proc/{name}/stat") as file:
                parents[int(name)] = int(file.read().rpartition(")")[2].split()[1])
            with open(f"/proc/{name}/cmdline") as file:
                is_actor = "Map" in (text := file.read()) and text.startswith("ray::") and "Animator" in text
        except OSError:
            continue
        if is_actor:
            found.append(int(name))
    def is_mine(process):
        while process in parents:
            process = parents[process]
            if process == os.getpid():
                return True
        return False
    return [process for process in found if is_mine(process)]


def here(lines, folder, format=".npz", animator=None, **settings):
    """An actor's work in this process: rows by file name."""
    work = [json.dumps(umo.ray._line(line, str(folder), format)) for line in lines]
    columns = (animator or umo.ray.Animator(**settings))({"line": np.array(work)})
    rows = [dict(zip(columns, row)) for row in zip(*(values.tolist() for values in columns.values()))]
    return {os.path.basename(row["file"]): row for row in rows}


def state(folder):
    return {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in folder.iterdir()}


def same(output, line, model):
    with wave.open(str(line)) as file:
        samples, rate = np.frombuffer(file.readframes(file.getnframes()), "<i2"), file.getframerate()
    motion = umo.animate(samples, rate, model=model)
    wanted = output.with_name("wanted.npz")
    motion.save(wanted)
    with np.load(output) as mine, np.load(wanted) as reference:
        assert all(np.array_equal(mine[name], reference[name]) for name in reference.files) and len(mine["poses"]) == 45
    wanted.unlink()


def test_a_killed_worker_loses_nothing_and_nothing_comes_twice(cluster, lines, model, tmp_path):
    folder, killed = tmp_path / "motion", []

    def kill():
        while not killed:
            time.sleep(0.005)
            done = len(list(folder.glob("*.npz"))) if folder.is_dir() else 0
            victims = workers() if done >= 1 else []
            if victims:
                os.kill(victims[0], signal.SIGKILL)
                killed.append((victims[0], done, len(victims)))

    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    dataset = umo.ray.animate([f"file://{line}" for line in lines], f"file://{folder}", actors=WORKERS, jobs=2)
    rows = dataset.take_all()
    killer.join(10)
    (_, done, count), = killed
    assert done < len(lines) and count > 1, killed
    assert sorted(row["file"] for row in rows) == sorted(f"file://{line}" for line in lines)
    # A line that was written just before its worker died is kept on the second try.
    assert {row["status"] for row in rows} <= {"done", "kept"} and {row["frames"] for row in rows} == {45}
    names = sorted(path.name for path in folder.iterdir() if not path.name.endswith(".part"))
    wanted = [f"{line.stem}.npz" for line in lines]
    assert names == sorted(wanted + [f".{name}.umo.json" for name in wanted])
    for line in (lines[0], lines[5], lines[-1]):
        same(folder / f"{line.stem}.npz", line, model)


def test_a_second_run_makes_what_is_not_done_or_not_the_same(lines, tmp_path):
    folder, lines = tmp_path / "motion", lines[:8]
    work = [{"file": str(line), "seed": number, "mood": "joy" if number == 3 else None} for number, line in enumerate(lines)]
    animator = umo.ray.Animator()

    def run(**settings):
        return here(work, folder, ".csv", None if settings else animator, **settings)

    first = run()
    assert {row["status"] for row in first.values()} == {"done"} and len(first) == len(lines)
    before = state(folder)
    for line in lines:
        # Modification times are ignored.
        os.utime(line)
    assert {row["status"] for row in run().values()} == {"kept"} and state(folder) == before
    # Another recording, a corrupted output, a deleted note, another seed.
    lines[0].write_bytes(lines[1].read_bytes())
    (folder / "line02.csv").write_bytes(b"spoilt")
    (folder / ".line04.csv.umo.json").unlink()
    work[6]["seed"] = 60
    second = run()
    made = sorted(name for name, row in second.items() if row["status"] == "done")
    assert made == ["line00.wav", "line02.wav", "line04.wav", "line06.wav"]
    assert {row["status"] for name, row in second.items() if name not in made} == {"kept"}
    assert second["line02.wav"]["sha256"] == first["line02.wav"]["sha256"]
    assert second["line06.wav"]["sha256"] != first["line06.wav"]["sha256"]
    # Another setting recomputes everything.
    assert {row["status"] for row in run(settings={"parameters": {"gain_face": 0.5}}).values()} == {"done"}
    assert {row["status"] for row in run(settings={"parameters": {"gain_face": 0.5}}, again=True).values()} == {"done"}


def test_a_line_that_fails_takes_no_other_with_it(lines, tmp_path):
    broken, empty = tmp_path / "broken.wav", tmp_path / "empty.wav"
    broken.write_bytes(b"no audio")
    with wave.open(str(empty), "wb") as file:
        file.setparams((1, 2, 16000, 0, "NONE", ""))
    short = tmp_path / "short.wav"
    with wave.open(str(short), "wb") as file:
        file.setparams((1, 2, 16000, 0, "NONE", ""))
        file.writeframes(bytes(20))
    files = [str(path) for path in (lines[0], broken, empty, tmp_path / "none.wav", short, lines[1])]
    rows = here([*files, {"file": str(lines[2]), "mood": "merry"}], tmp_path / "motion")
    told = {name: (row["status"], row["error"]) for name, row in rows.items()}
    assert told["line00.wav"] == told["line01.wav"] == ("done", "")
    for name, message in (
        ("broken.wav", "LibsndfileError"),
        ("empty.wav", "no samples"),
        ("none.wav", "FileNotFoundError"),
        ("short.wav", "no frames"),
        ("line02.wav", "mood 'merry'"),
    ):
        assert told[name][0] == "failed" and message in told[name][1], told[name]
    names = {path.name for path in (tmp_path / "motion").iterdir()}
    assert names == {"line00.npz", ".line00.npz.umo.json", "line01.npz", ".line01.npz.umo.json"}


def test_any_file_system_of_fsspec(hello, model, lines):
    import fsspec

    system = fsspec.filesystem("memory")
    system.pipe_file("/speech/a.wav", lines[0].read_bytes())
    work = [{"file": "memory://speech/a.wav", "output": "x/a.bvh"}]
    assert here(work, "memory://motion")["a.wav"]["status"] == "done"
    assert here(work, "memory://motion")["a.wav"]["status"] == "kept"
    assert system.cat_file("/motion/x/a.bvh").startswith(b"HIERARCHY")
    assert sorted(system.ls("/motion/x", detail=False)) == ["/motion/x/.a.bvh.umo.json", "/motion/x/a.bvh"]


def test_wrong_lines_are_refused_before_any_work():
    for lines, message in (
        ([], "no lines"),
        (["a.wav", "b/a.wav"], "one output"),
        ([{"file": "a.wav", "sed": 1}], "field 'sed' is unknown; expected file, output, seed"),
        ([{"file": "a.wav", "seed": "1"}], "expected int"),
        ([{"seed": 1}], "expected a `file`"),
        ([{"file": "a.wav", "output": "a.fbx"}], "fbx"),
        ([{"file": "a.wav", "output": "/a.npz"}], "outside the outputs' folder"),
        ([{"file": "a.wav", "output": "b/../../a.npz"}], "outside the outputs' folder"),
        ([{"file": "a.wav", "output": "s3://bucket/a.npz"}], "outside the outputs' folder"),
        ([{"file": "motion/a.npz", "output": "b/../a.npz"}], "an input and an output"),
        ([{"file": "a.wav", "output": "x.npz"}, {"file": "b.wav", "output": "y/../x.npz"}], "one output"),
    ):
        with pytest.raises(ValueError, match=message):
            umo.ray.animate(lines, "motion")
    with pytest.raises(ValueError, match="actors 0"):
        umo.ray.animate(["a.wav"], "motion", actors=0)
