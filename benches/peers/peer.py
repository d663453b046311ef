"""A peer that answers on standard input, so that another side can be timed in between.

Usage: `peer.py onnxruntime|ctranslate2|pytorch FOLDER`, with the folder filled by `models.build`.
After `ready`, each line `part kind threads repetitions` is answered with the milliseconds of the
calls.
"""

import copy
import functools
import pathlib
import sys
import time

import models


def onnxruntime_call(folder, part, kind, threads):
    ids, bias, audio = models.token_ids(), models.encoder_bias(), models.audio()
    if part in ("steps", "chunk"):
        t5 = models.OnnxT5(folder, kind, threads, models.STEP_ROWS if part == "steps" else models.CHUNK_ROWS)
        return lambda: t5.chunk(ids)
    session = models.session(folder / f"{part}.{kind}.onnx", threads)
    inputs = {
        "encoder": lambda: {"ids": ids, "bias": bias},
        "hubert": lambda: {"audio": audio},
        "face": models.face_inputs,
    }[part]()
    return lambda: session.run(None, inputs)


def ctranslate2_call(folder, part, kind, threads):
    import ctranslate2

    options = {"compute_type": {"int8": "int8_float32"}[kind], "intra_threads": threads, "inter_threads": 1}
    ids = models.token_ids()
    if part == "encoder":
        encoder = ctranslate2.Encoder(str(folder / "ctranslate2-encoder"), **options)
        return lambda: encoder.forward_batch(ids.tolist())
    translator = ctranslate2.Translator(str(folder / "ctranslate2"), **options)
    length = {"min_decoding_length": models.STEPS, "max_decoding_length": models.STEPS}
    return lambda: translator.translate_batch([models.pieces(ids[0])], beam_size=1, **length)


def pytorch_call(part, kind, threads):
    import torch

    torch.set_num_threads(threads)
    model, x = {
        "encoder": (lambda: models.t5().encoder, torch.from_numpy(models.token_ids())),
        "hubert": (models.hubert, torch.from_numpy(models.audio())),
    }[part]
    model = model()
    if kind == "int8":
        model = torch.ao.quantization.quantize_dynamic(copy.deepcopy(model), {torch.nn.Linear}, dtype=torch.qint8)

    def call():
        torch.set_num_threads(threads)
        with torch.inference_mode():
            model(x)

    return call


def main():
    peer, folder = sys.argv[1], pathlib.Path(sys.argv[2])
    calls = {
        "onnxruntime": functools.partial(onnxruntime_call, folder),
        "ctranslate2": functools.partial(ctranslate2_call, folder),
        "pytorch": pytorch_call,
    }
    make = functools.cache(calls[peer])
    print("ready", flush=True)
    for line in iter(sys.stdin.readline, ""):
        part, kind, threads, repetitions = line.split()
        call = make(part, kind, int(threads))
        times = []
        for _ in range(int(repetitions)):
            start = time.perf_counter()
            call()
            times.append(1e3 * (time.perf_counter() - start))
        print(*(f"{ms:.4f}" for ms in times), flush=True)


if __name__ == "__main__":
    main()
