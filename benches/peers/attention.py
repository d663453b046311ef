"""Times fused attention beside PyTorch's scaled_dot_product_attention with the same additive bias, in turn.

Ours is `cargo build --release -p umo-kernels --example attention_times`; give the program's path and the thread count:

    python benches/peers/attention.py target/release/examples/attention_times --threads 2

PyTorch is timed with heads as views of [rows, heads * head_dim], as in ours, with densely stored heads, and as
softmax(q k^T + bias) v in separate calls, in f32, and for an encoder's attention also in bf16 with factors rounded to
bf16. The faster of the first two counts as the fused call. Every round times each side once; the table shows each
side's fastest call of all and the median of its rounds' medians.
"""

import argparse
import statistics
import subprocess
import time

import torch
import torch.nn.functional as F

# Queries, keys, and the precision of our factors and of PyTorch's tensors.
SHAPES = [
    ("encoder", 256, 256, "f32", "f32"),
    ("encoder", 512, 512, "f32", "f32"),
    ("encoder", 256, 256, "bf16", "f32"),
    ("encoder", 256, 256, "bf16", "bf16"),
    ("one row", 1, 256, "f32", "f32"),
    ("four rows", 4, 256, "f32", "f32"),
]
TYPES = {"f32": torch.float32, "bf16": torch.bfloat16}
HEADS, HEAD_DIM, SCALE = 12, 64, 0.125


def sides(queries, keys, precision):
    """PyTorch's three variants."""
    bias = torch.randn(1, HEADS, queries, keys, dtype=TYPES[precision])
    flat = [torch.randn(1, rows, HEADS * HEAD_DIM, dtype=TYPES[precision]) for rows in (queries, keys, keys)]
    views = [x.view(1, -1, HEADS, HEAD_DIM).transpose(1, 2) for x in flat]
    dense = [x.contiguous() for x in views]

    def fused(q, k, v):
        return lambda: F.scaled_dot_product_attention(q, k, v, attn_mask=bias, scale=SCALE)

    q, k, v = dense
    return [fused(*views), fused(*dense), lambda: torch.softmax(q @ k.transpose(-1, -2) * SCALE + bias, -1) @ v]


def fastest_and_median(call, repetitions):
    times = []
    for _ in range(repetitions):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times) * 1e6, statistics.median(times) * 1e6


def measure(program, isa, threads, rounds):
    """For every shape: name, queries, keys and precisions, and microseconds (fastest, median) of ours, the fused and
    the separate calls.
    """
    torch.set_num_threads(threads)
    ours = subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def our_times(queries, keys, precision, repetitions):
        request = [isa, queries, keys, HEADS, HEAD_DIM, threads, repetitions, precision]
        ours.stdin.write(" ".join(map(str, request)) + "\n")
        ours.stdin.flush()
        return tuple(float(word) for word in ours.stdout.readline().split())

    with torch.inference_mode():
        for name, queries, keys, mine, theirs in SHAPES:
            repetitions = max(10, 2_000_000 // (queries * keys + 20_000))
            calls = sides(queries, keys, theirs)
            times = [[], [], []]
            for _ in range(rounds):
                times[0].append(our_times(queries, keys, mine, repetitions))
                views, dense, separate = (fastest_and_median(call, repetitions) for call in calls)
                times[1].append(tuple(map(min, views, dense)))
                times[2].append(separate)
            shape = name, queries, keys, mine, theirs
            yield *shape, *[(min(f for f, _ in t), statistics.median(m for _, m in t)) for t in times]
    ours.stdin.close()
    ours.wait()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("--isa", default="amx")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=15)
    arguments = parser.parse_args()
    print(f"{arguments.isa}, {arguments.threads} threads, PyTorch {torch.__version__}; microseconds, fastest / median")
    print("| shape | ours | fused | separate | fused / ours | separate / ours |")
    print("| --- | --- | --- | --- | --- | --- |")
    rows = measure(arguments.program, arguments.isa, arguments.threads, arguments.rounds)
    for name, queries, keys, mine, theirs, *totals in rows:
        cells = [f"{name} {queries} x {keys} x {HEADS}, {mine} beside {theirs}"]
        cells += [f"{fastest:.0f} / {median:.0f}" for fastest, median in totals]
        for theirs in totals[1:]:
            cells.append(" / ".join(f"{their / our:.2f}" for their, our in zip(theirs, totals[0])))
        print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
