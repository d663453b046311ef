"""Times fused attention beside PyTorch's scaled_dot_product_attention with the same additive bias, one after the other.

Ours is `cargo build --release -p umo-kernels --example attention_times`; give the program's path and the thread count:

    python benches/peers/attention.py target/release/examples/attention_times --threads 2

PyTorch is timed with heads as views of [rows, heads * head_dim], as ours are, with heads laid out densely, and as
softmax(q k^T + bias) v in separate calls; the fastest of the three stands for it. Every round times each side once;
the table shows the fastest and the median round of each.
"""

import argparse
import statistics
import subprocess
import time

import torch
import torch.nn.functional as F

SHAPES = [("encoder", 256, 256), ("encoder", 512, 512), ("one row", 1, 256), ("four rows", 4, 256)]
HEADS, HEAD_DIM, SCALE = 12, 64, 0.125


def sides(queries, keys):
    """The three ways that PyTorch can be asked."""
    bias = torch.randn(1, HEADS, queries, keys)
    flat = [torch.randn(1, rows, HEADS * HEAD_DIM) for rows in (queries, keys, keys)]
    views = [x.view(1, -1, HEADS, HEAD_DIM).transpose(1, 2) for x in flat]
    dense = [x.contiguous() for x in views]

    def fused(q, k, v):
        return lambda: F.scaled_dot_product_attention(q, k, v, attn_mask=bias, scale=SCALE)

    q, k, v = dense
    return [fused(*views), fused(*dense), lambda: torch.softmax(q @ k.transpose(-1, -2) * SCALE + bias, -1) @ v]


def median_time(call, repetitions):
    times = []
    for _ in range(repetitions):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return statistics.median(times) * 1e6


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("--isa", default="avx512vnni")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=15)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    ours = subprocess.Popen([arguments.program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def our_median(queries, keys, repetitions):
        request = [arguments.isa, queries, keys, HEADS, HEAD_DIM, arguments.threads, repetitions]
        ours.stdin.write(" ".join(map(str, request)) + "\n")
        ours.stdin.flush()
        return float(ours.stdout.readline().split()[1])

    print(f"{arguments.isa}, {arguments.threads} threads, PyTorch {torch.__version__}; microseconds, fastest / median round")
    print("| shape | ours | PyTorch | PyTorch / ours, fastest | median |")
    print("| --- | --- | --- | --- | --- |")
    with torch.inference_mode():
        for name, queries, keys in SHAPES:
            repetitions = max(10, 2_000_000 // (queries * keys + 20_000))
            calls = sides(queries, keys)
            mine, theirs = [], []
            for _ in range(arguments.rounds):
                mine.append(our_median(queries, keys, repetitions))
                theirs.append(min(median_time(call, repetitions) for call in calls))
            best, middle = min(theirs) / min(mine), statistics.median(theirs) / statistics.median(mine)
            shape = f"{name} {queries} x {keys} x {HEADS}"
            times = [f"{min(side):.0f} / {statistics.median(side):.0f}" for side in (mine, theirs)]
            print(f"| {shape} | {times[0]} | {times[1]} | {best:.2f} | {middle:.2f} |", flush=True)


if __name__ == "__main__":
    main()
