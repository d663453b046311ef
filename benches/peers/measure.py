"""Times us beside the peers in turn, and writes a row per pair to benches/results/<cpu>.csv.

Called by `run`; `--only` runs one group of measurements, whose rows then replace those of the same name in the file,
and `--table` measures nothing and writes the table of all processors' files into docs/performance.md.
"""

import argparse
import csv
import datetime
import importlib.metadata
import math
import os
import pathlib
import re
import statistics
import subprocess
import sys
import time

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
TARGET = ROOT / "target"
MODELS = TARGET / "peers"
COLUMNS = ["what", "ours", "peer", "threads", "our_ms", "peer_ms", "ratio", "floor_ms", "date", "version"]
# Calls per turn: more for a step, which takes a few milliseconds.
ROUNDS, CALLS = 15, {"step": 20, "reading": 20}
# Peers' threads spin for some milliseconds after their work: wait before the other side's turn.
REST = 0.1
NAMES = {"onnxruntime": "ONNX Runtime", "ctranslate2": "CTranslate2", "pytorch": "PyTorch"}
PACKAGES = {"pytorch": "torch"}
READING = "reading as many bytes"
# Rows of the documentation's table: the measurement, and threads.
SHOWN = [
    ("encoder; 256 tokens", "2"),
    ("encode 256 tokens and generate 20 codes", "1"),
    ("encode 256 tokens and generate 20 codes; with markers", "2"),
    ("HuBERT to layer 9; 3 s of audio", "2"),
    ("half a second of an avatar; a peer's face alone", "1"),
    ("attention; encoder; 256 x 256 x 12 heads", "1"),
]
# Products with this number of rows, all shapes together.
SHOWN_PRODUCTS = ("256 rows", "1")
# Processor names in the documentation; on the Zen 3 only the face was measured.
PROCESSORS = {
    "amd-epyc-zen-4": "Zen 4",
    "amd-epyc": "Zen 5",
    "intel-xeon-processor-amx": "Sapphire Rapids, AMX",
    "intel-xeon-processor": "Sapphire Rapids without AMX",
}
# Measurements: the part, threads, and the peers with their weights' precision.
PARTS = [
    ("encoder", 2, ["onnxruntime int8", "ctranslate2 int8", "pytorch int8", "onnxruntime f32", "pytorch f32"]),
    ("step", 2, ["reading int8"]),
    ("step", 1, ["reading int8"]),
    ("steps", 2, ["onnxruntime int8", "ctranslate2 int8"]),
    ("steps", 1, ["onnxruntime int8", "ctranslate2 int8"]),
    ("chunk", 2, ["onnxruntime int8"]),
    ("chunk", 1, ["onnxruntime int8"]),
    ("hubert", 2, ["onnxruntime int8", "pytorch int8", "onnxruntime f32", "pytorch f32"]),
    ("face", 2, ["onnxruntime int8", "onnxruntime f32"]),
    ("face", 1, ["onnxruntime int8", "onnxruntime f32"]),
]
WHAT = {
    "encoder": "encoder; 256 tokens",
    "step": "one step of the decoder; 256 tokens",
    "steps": "encode 256 tokens and generate 20 codes",
    "chunk": "encode 256 tokens and generate 20 codes; with markers",
    "hubert": "HuBERT to layer 9; 3 s of audio",
    "face": "half a second of an avatar; a peer's face alone",
}


# Hosts hide AMD processor names; family and model identify architectures other than Zen 5.
ZEN = {(25, 1): "zen-3", (25, 17): "zen-4", (25, 160): "zen-4"}


def cpu():
    """The processor's name in kebab case, with AMX where the system offers it: some virtual machines hide it."""
    info = pathlib.Path("/proc/cpuinfo").read_text()
    name = re.search(r"model name\s*:\s*(.*)", info).group(1)
    name = re.sub(r"\((R|TM)\)|CPU|@.*", " ", name, flags=re.IGNORECASE)
    name = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")
    numbers = re.search(r"cpu family\s*:\s*(\d+)\nmodel\s*:\s*(\d+)", info)
    zen = ZEN.get(tuple(map(int, numbers.groups()))) if numbers and name == "amd-epyc" else None
    kind = zen or ("amx" if "amx_tile" in info else None)
    return f"{name}-{kind}" if kind else name


def version():
    """Our version with the commit."""
    text = (ROOT / "Cargo.toml").read_text()
    commit = subprocess.run(["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True)
    return f"{re.search(r'version = .([0-9.]+)', text).group(1)} {commit.stdout.strip()}".strip()


def peer_name(peer):
    package, kind = peer.split()
    if package == "reading":
        return READING
    return f"{NAMES[package]} {importlib.metadata.version(PACKAGES.get(package, package))} {kind}"


class Side:
    """A program that prints `ready`, possibly after other output, and then answers each line with a line."""

    def __init__(self, *command):
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def wait(self):
        for line in iter(self.process.stdout.readline, "ready\n"):
            if not line:
                raise RuntimeError(f"{self.process.args} has ended")

    def ask(self, *words):
        self.process.stdin.write(" ".join(map(str, words)) + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline()
        if not answer:
            raise RuntimeError(f"no answer to {words}")
        return answer.strip()

    def times(self, part, kind, threads):
        """Milliseconds of several calls, after one call to wake the threads."""
        time.sleep(REST)
        return [float(ms) for ms in self.ask(part, kind, threads, 1 + CALLS.get(part, 3)).split()][1:]

    def close(self):
        self.process.stdin.close()
        self.process.wait()


def parts(isa, wanted):
    entries = [entry for entry in PARTS if entry[0] == wanted]
    names = {other.split()[0] for _, _, others in entries for other in others} - {"reading"}
    if names:
        import models

        models.build(MODELS, wanted)
    peers = {name: Side(sys.executable, HERE / "peer.py", name, MODELS) for name in names}
    ours = Side(TARGET / "release" / "parts")
    for side in [ours, *peers.values()]:
        side.wait()
    for part, threads, others in entries:
        # The bytes of a step are read by our own threads.
        sides = [(peers.get(other.split()[0], ours), other.split()[1]) for other in others]
        asked = ["reading" if other.startswith("reading") else part for other in others]
        sides = [(side, what, kind) for (side, kind), what in zip(sides, asked)] + [(ours, part, "int8")]
        # A peer loads its model in the first call.
        for side, what, kind in sides:
            side.times(what, kind, threads)
        rounds, floors = [], []
        for _ in range(ROUNDS):
            rounds.append([side.times(what, kind, threads) for side, what, kind in sides])
            floors.append(float(ours.ask(part, "int8", threads, "floor")))
        print(ours.ask("peaks", "int8", threads, 0), flush=True)
        calls = [sum(times, []) for times in zip(*rounds)]
        # Each side's time in a moment without load from the host's other guests.
        fastest = (f"{name} {min(times):.4g}" for name, times in zip([*map(peer_name, others), "ours"], calls))
        print(f"{WHAT[part]}, {threads} threads, fastest call of each, ms: {', '.join(fastest)}", flush=True)
        *medians, our_median = map(statistics.median, calls)
        for other, median in zip(others, medians):
            # Other load on the host can only lower the measured peaks.
            yield WHAT[part], f"int8 {isa}", peer_name(other), threads, our_median, median, min(floors)
    for side in [ours, *peers.values()]:
        side.close()


def attentions(isa):
    import attention
    import torch

    program = TARGET / "release" / "examples" / "attention_times"
    ours = Side(TARGET / "release" / "parts")
    ours.wait()
    for threads in [1, 2]:
        macs_per_ms = 1e6 * float(ours.ask("f32", "int8", threads, "peak"))
        rows = attention.measure(program, isa, threads, rounds=9)
        for name, queries, keys, mine, theirs, our_times, fused, _ in rows:
            floor = 2 * queries * keys * attention.HEADS * attention.HEAD_DIM / macs_per_ms
            what = f"attention; {name}; {queries} x {keys} x {attention.HEADS} heads"
            medians = [times[1] / 1e3 for times in (our_times, fused)]
            # With bf16 factors the limit are tiles, at 16 times the f32 rate, or pairs, at twice.
            floor /= {"amx": 16, "avx512bf16": 2}.get(isa, 1) if mine == "bf16" else 1
            yield what, f"{mine} {isa}", f"PyTorch {torch.__version__} {theirs}", threads, *medians, floor
    ours.close()


def products(isa, threads):
    """With tiles, int8 is timed a second time with both sides not using them."""
    mkl = next(pathlib.Path(sys.prefix, "lib").glob("libmkl_rt.so.*"))
    runs = [(isa, "", {})]
    if isa == "amx":
        runs.append(("avx512vnni", "int8", {"MKL_ENABLE_INSTRUCTIONS": "AVX512_E1"}))
    for isa, wanted, extra in runs:
        environment = {
            **os.environ, "UMO_MKL": str(mkl), "LD_LIBRARY_PATH": str(mkl.parent), "KMP_BLOCKTIME": "1",
            "MATMUL_NUM_THREADS": str(threads), **extra,
        }  # fmt: skip
        command = [TARGET / "release" / "products", isa, str(threads), "0.2", wanted]
        output = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True).stdout
        for line in output.splitlines():
            name, peer, _, our_ms, peer_ms, floor_ms = line.split(",")
            kind, shape, rows, isa = re.fullmatch(r"(\w+) (.+); (\d+) rows; (\w+)", name).groups()
            if peer == "MKL":
                peer = f"MKL {importlib.metadata.version('mkl')}"
            what = f"product; {shape}; {rows} row{'s' * (rows != '1')}"
            peer = peer if peer == READING else f"{peer} {kind}"
            yield what, f"{kind} {isa}", peer, threads, float(our_ms), float(peer_ms), float(floor_ms)


def row(stamp, what, ours, peer, threads, our_ms, peer_ms, floor_ms):
    values = [what, ours, peer, threads, f"{our_ms:.4g}", f"{peer_ms:.4g}", f"{peer_ms / our_ms:.2f}", f"{floor_ms:.4g}"]
    return dict(zip(COLUMNS, map(str, [*values, *stamp])))


def share(row):
    """Share of the floor in our time; there is no known floor for a whole avatar."""
    share = 100 * float(row["floor_ms"]) / float(row["our_ms"])
    return "–" if math.isnan(share) else f"{share:.0f} %"


def show(row):
    cells = [row["what"], row["ours"], row["threads"], row["our_ms"], row["peer"], row["peer_ms"], row["ratio"]]
    return "| " + " | ".join(cells) + f" | {row['floor_ms']} | {share(row)} |"


HEADER = "| what | ours | threads | ms | peer | ms | peer's / ours | floor, ms | share |\n" + "| --- " * 9 + "|"


def bare(peer):
    """A peer's name without its version."""
    return re.sub(r" \d[\w.+]*", "", peer)


def grid(head, rows):
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [head, ["---"] * len(head), *rows])


def shown_cells(name, rows):
    """A processor's cells of the documentation's table by row: umo's time, and the ratio of the fastest peer's to it.
    """
    found, products = {}, {}
    for row in rows:
        kind = row["ours"].split()[0]
        if (row["what"], row["threads"]) in SHOWN:
            found.setdefault((row["what"], kind, row["threads"]), []).append(row)
        elif row["what"].startswith("product") and (row["what"].split("; ")[2], row["threads"]) == SHOWN_PRODUCTS:
            # With tiles, the same product without them is timed too.
            isa, peer = row["ours"].split()[1], bare(row["peer"])
            if peer.split()[0] in product_peers(name):
                key = f"products, {SHOWN_PRODUCTS[0]}{' without tiles' if kind == 'int8' and isa != 'amx' else ''}"
                products.setdefault((key, kind, row["threads"]), {}).setdefault(peer, []).append(float(row["ratio"]))
    cells = {}
    for key, of in found.items():
        best = min(of, key=lambda row: float(row["peer_ms"]))
        part = "" if share(best) == "–" else f", floor {share(best)}"
        cells[key] = f"{best['our_ms']} ms{part}", f"{best['ratio']}, {bare(best['peer'])}"
    for key, by_peer in products.items():
        peer, ratios = min(by_peer.items(), key=lambda each: statistics.median(each[1]))
        cells[key] = "–", f"{min(ratios):.2f} to {max(ratios):.2f}, {peer}"
    return cells


def product_peers(name):
    """On AMD's processors MKL does not use VNNI and AVX-512, so it is not a peer there."""
    return ["faer"] if name.startswith("amd") else ["MKL", "faer"]


def read(path):
    if not path.exists():
        return {}
    with path.open(newline="") as file:
        return {(r["what"], r["ours"], r["peer"], r["threads"]): r for r in csv.DictReader(file)}


def document(paths):
    """Writes the table into the documentation."""
    page = ROOT / "docs" / "performance.md"
    begin, end = "<!-- made by benches/peers/run --table -->\n", "<!-- end -->"
    rows = {path.stem: list(read(path).values()) for path in paths}
    by_stem = {stem: rows[stem] for stem in PROCESSORS if stem in rows}
    files = [
        f"[{PROCESSORS[stem]}](../benches/results/{stem}.csv) {max(row['date'] for row in of)}"
        for stem, of in by_stem.items()
    ]
    cells = {stem: shown_cells(stem, of) for stem, of in by_stem.items()}
    keys = sorted({key for of in cells.values() for key in of}, key=lambda key: ([*dict(SHOWN), key[0]].index(key[0]), key))
    head = ["umo, and the fastest peer's time over it", "threads"]
    head += [column for stem in by_stem for column in (PROCESSORS[stem], "peer")]
    lines = [
        [f"{what}, {kind}", threads, *(cell for of in cells.values() for cell in of.get((what, kind, threads), ("–", "–")))]
        for what, kind, threads in keys
    ]
    before, rest = page.read_text().split(begin)
    text = f"{grid(head, lines)}\n\nAll rows: {', '.join(files)}.\n"
    page.write_text(f"{before}{begin}{text}{end}{rest.split(end)[1]}")


def main():
    groups = {
        "encoder": lambda isa: parts(isa, "encoder"),
        "step": lambda isa: parts(isa, "step"),
        "steps": lambda isa: parts(isa, "steps"),
        "chunk": lambda isa: parts(isa, "chunk"),
        "hubert": lambda isa: parts(isa, "hubert"),
        "face": lambda isa: parts(isa, "face"),
        "attention": attentions,
        "products-1": lambda isa: products(isa, 1),
        "products-2": lambda isa: products(isa, 2),
    }
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=groups, action="append")
    parser.add_argument("--table", action="store_true")
    arguments = parser.parse_args()
    path = HERE.parent / "results" / f"{cpu()}.csv"
    if arguments.table:
        return document(sorted(path.parent.glob("*.csv")))
    rows = read(path) if arguments.only else {}
    side = Side(TARGET / "release" / "parts")
    side.wait()
    isa = side.ask("isa", "int8", 1, 0)
    side.close()
    stamp = [datetime.date.today().isoformat(), version()]
    print(HEADER)
    for group in arguments.only or groups:
        for values in groups[group](isa):
            new = row(stamp, *values)
            rows[(new["what"], new["ours"], new["peer"], new["threads"])] = new
            print(show(new), flush=True)
    path.parent.mkdir(exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows.values())
    print(f"written to {path.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
