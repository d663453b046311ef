"""The peers' models: random weights of the base shape, for PyTorch, ONNX and CTranslate2.

`build(folder, part)` makes the files of a part once. Each ONNX graph is compared with the PyTorch model that it was
made from before it is quantised, to be sure that the timed network is the same.
"""

import copy
import functools
import pathlib

import numpy as np
import onnx
import onnxruntime
import torch
import transformers
from onnx import TensorProto, helper, numpy_helper
from onnxruntime.quantization import QuantType, quantize_dynamic

TOKENS, STEPS, SECONDS = 256, 20, 3
# New ids in each pass of the decoder: 20 codes one after the other; and those of a chunk, whose four parts of five
# codes start and end with markers that need no sampling and so are combined with the code before them.
STEP_ROWS = [1] * STEPS
CHUNK_ROWS = [2, 1, 1, 1, 1] + 3 * [3, 1, 1, 1, 1]
MARKERS = [1, 2]
# The codes of four parts: a head for text and audio as well would only slow the peers down.
HEAD = 1024
LAYERS, HEADS, HEAD_DIM = 12, 12, 64
# The face network: frames of half a second of speech, each of which reads a window of samples.
FACE_FRAMES, FACE_WINDOW = 15, 8320


def t5_config():
    return transformers.T5Config(
        vocab_size=HEAD, d_model=768, d_kv=HEAD_DIM, d_ff=2048, num_layers=LAYERS, num_decoder_layers=LAYERS,
        num_heads=HEADS, feed_forward_proj="gated-gelu", tie_word_embeddings=False, decoder_start_token_id=0,
    )  # fmt: skip


@functools.cache
def t5():
    torch.manual_seed(1)
    model = transformers.T5ForConditionalGeneration(t5_config()).eval()
    # The library ties the head to the embeddings without the scaling; such a model would repeat its input.
    model.lm_head.weight = torch.nn.Parameter(torch.randn(HEAD, 768) / 768**0.5)
    model.config.tie_word_embeddings = False
    return model


@functools.cache
def hubert():
    torch.manual_seed(2)
    return transformers.HubertModel(transformers.HubertConfig(num_hidden_layers=9, apply_spec_augment=False)).eval()


class FaceNet(torch.nn.Module):
    """A regression network with the published shape of Audio2Face-3D 2.3 (arXiv 2508.16401 and its training framework):
    for each frame a window of 0.52 s through the first layer of wav2vec 2.0 (base) and autocorrelation, then
    convolutions over time with an additional emotion input; the outputs are coefficients of skin, jaw and eyes, and
    of the tongue.
    """

    WINDOWS, LENGTH, STRIDE, LAGS, EMOTION = 25, 640, 320, 32, 24
    SKIN_JAW_EYES, TONGUE = 272 + 15 + 4, 10

    def __init__(self):
        super().__init__()
        config = transformers.Wav2Vec2Config(num_hidden_layers=1, apply_spec_augment=False)
        self.speech = transformers.Wav2Vec2Model(config)
        self.speech_map = torch.nn.Linear(768, 256)
        widths = [1, 72, 108, 162, 243]
        self.lags = torch.nn.ModuleList(
            torch.nn.Conv2d(a, b, (1, 3), stride=(1, 2), padding=(0, 1)) for a, b in zip(widths, widths[1:])
        )
        self.lags.append(torch.nn.Conv2d(243, 256, (1, 2)))
        times = [512] + 3 * [256 + self.EMOTION]
        self.times = torch.nn.ModuleList(
            torch.nn.Conv2d(width, 256, (3, 1), stride=(2, 1), padding=(1, 0)) for width in times
        )
        self.joined = torch.nn.Linear(2 * (256 + self.EMOTION), 256)
        self.skin = torch.nn.ModuleList([torch.nn.Linear(256 + self.EMOTION, self.SKIN_JAW_EYES),
                                         torch.nn.Linear(self.SKIN_JAW_EYES, self.SKIN_JAW_EYES)])  # fmt: skip
        self.tongue = torch.nn.ModuleList([torch.nn.Linear(256 + self.EMOTION, self.TONGUE),
                                           torch.nn.Linear(self.TONGUE, self.TONGUE)])  # fmt: skip

    def autocorrelation(self, windows):
        """`[frames, samples]` to `[frames, 1, windows, lags]`."""
        x = windows.unfold(1, self.LENGTH, self.STRIDE)
        x = (x - x.mean(-1, keepdim=True)) * torch.hann_window(self.LENGTH, periodic=False)
        lags = [(x[..., : self.LENGTH - lag] * x[..., lag:]).sum(-1) for lag in range(self.LAGS)]
        return torch.stack(lags, -1)[:, None] / self.LENGTH

    def forward(self, windows, emotion):
        """`windows [frames, 8320]`, `emotion [frames, 24]` to `[frames, 301]`."""

        def active(x):
            return 2**0.5 * torch.relu(x)

        def with_emotion(x):
            return torch.cat([x, emotion[:, :, None, None].expand(-1, -1, *x.shape[2:])], 1)

        heard = torch.relu(self.speech_map(self.speech(windows).last_hidden_state))
        x = self.autocorrelation(windows)
        for layer in self.lags:
            x = active(layer(x))
        x = torch.cat([heard.transpose(1, 2)[..., None], x], 1)
        for layer in self.times:
            x = with_emotion(active(layer(x)))
        x = torch.cat([active(self.joined(x.flatten(1))), emotion], 1)
        return torch.cat([second(first(x)) for first, second in (self.skin, self.tongue)], 1)


@functools.cache
def face():
    torch.manual_seed(6)
    return FaceNet().eval()


def face_inputs():
    random = np.random.default_rng(7)
    return {
        "windows": 0.1 * random.standard_normal((FACE_FRAMES, FACE_WINDOW)).astype(np.float32),
        "emotion": random.random((FACE_FRAMES, FaceNet.EMOTION), np.float32),
    }


def token_ids():
    return np.random.default_rng(3).integers(3, HEAD, (1, TOKENS))


def audio():
    return 0.1 * np.random.default_rng(4).standard_normal((1, SECONDS * 16_000)).astype(np.float32)


def encoder_bias():
    """Relative bias of 256 positions, the same in every call: [1, heads, 256, 256]."""
    attention = t5().encoder.block[0].layer[0].SelfAttention
    with torch.inference_mode():
        return attention.compute_bias(TOKENS, TOKENS).numpy()


def decoder_biases(passes):
    """For every pass, the relative bias of its new positions with causal mask: [1, heads, rows, positions so far]."""
    attention = t5().decoder.block[0].layer[0].SelfAttention
    with torch.inference_mode():
        whole = attention.compute_bias(sum(passes), sum(passes))
    unseen = torch.full(whole.shape[2:], -1e9).triu(1)
    ends = np.cumsum(passes)
    return [(whole + unseen)[:, :, end - rows : end, :end].numpy().copy() for rows, end in zip(passes, ends)]


class Graph:
    """Nodes and weights of an ONNX graph under construction."""

    def __init__(self):
        self.nodes, self.weights, self.inputs, self.outputs, self.count = [], [], [], [], 0

    def weight(self, value):
        array = value.detach().numpy() if isinstance(value, torch.Tensor) else value
        name = f"w{len(self.weights)}"
        self.weights.append(numpy_helper.from_array(np.ascontiguousarray(array), name))
        return name

    def input(self, name, shape, kind=TensorProto.FLOAT):
        self.inputs.append(helper.make_tensor_value_info(name, kind, shape))
        return name

    def output(self, value, name, kind=TensorProto.FLOAT):
        self.nodes.append(helper.make_node("Identity", [value], [name]))
        self.outputs.append(helper.make_tensor_value_info(name, kind, None))

    def add(self, op, inputs, outputs=1, domain="", **attributes):
        self.count += 1
        names = [f"v{self.count}_{i}" for i in range(outputs)]
        self.nodes.append(helper.make_node(op, inputs, names, f"{op}_{self.count}", domain=domain, **attributes))
        return names[0] if outputs == 1 else names

    def linear(self, x, *layers):
        """Several linear `layers` of the same input as one product, split afterwards; with biases if there are any."""
        y = self.add("MatMul", [x, self.weight(torch.cat([layer.weight for layer in layers]).T)])
        if layers[0].bias is not None:
            y = self.add("Add", [y, self.weight(torch.cat([layer.bias for layer in layers]))])
        if len(layers) == 1:
            return y
        sizes = np.array([layer.out_features for layer in layers])
        return self.add("Split", [y, self.weight(sizes)], len(layers), axis=-1)

    def attention(self, q, k, v, scale, outputs=1, **optional):
        """ONNX Runtime's fused operation; `optional` are its bias, past key and past value."""
        names = ["attention_bias", "past_key", "past_value"]
        inputs = [q, k, v, "", ""] + [optional.get(name, "") for name in names]
        while not inputs[-1]:
            inputs.pop()
        domain = "com.microsoft"
        return self.add("MultiHeadAttention", inputs, outputs, domain, num_heads=HEADS, scale=scale)

    def rms_norm(self, x, norm):
        return self.add("SimplifiedLayerNormalization", [x, self.weight(norm.weight)], axis=-1, epsilon=1e-6)

    def skip_rms_norm(self, x, skip, norm):
        """The norm of `x + skip`, and the sum."""
        inputs = [x, skip, self.weight(norm.weight)]
        domain = "com.microsoft"
        self.count += 1
        names = [f"v{self.count}_0", "", "", f"v{self.count}_3"]
        self.nodes.append(
            helper.make_node("SkipSimplifiedLayerNormalization", inputs, names, domain=domain, epsilon=1e-6)
        )
        return names[0], names[3]

    def layer_norm(self, x, norm):
        weights = [self.weight(norm.weight), self.weight(norm.bias)]
        return self.add("LayerNormalization", [x, *weights], axis=-1, epsilon=norm.eps)

    def save(self, path):
        graph = helper.make_graph(self.nodes, path.stem, self.inputs, self.outputs, self.weights)
        opsets = [helper.make_opsetid("", 20), helper.make_opsetid("com.microsoft", 1)]
        onnx.save(helper.make_model(graph, opset_imports=opsets, ir_version=10), path)


def t5_feed_forward(g, x, layer):
    gate, up = g.linear(x, layer.wi_0, layer.wi_1)
    gate = g.add("Gelu", [gate], approximate="tanh")
    return g.linear(g.add("Mul", [gate, up]), layer.wo)


def t5_encoder(g):
    """Hidden states [1, tokens, 768] for `ids`."""
    model = t5()
    x = g.add("Gather", [g.weight(model.shared.weight), g.input("ids", [1, TOKENS], TensorProto.INT64)])
    bias = g.input("bias", [1, HEADS, TOKENS, TOKENS])
    update = None
    for block in model.encoder.block:
        attention, feed_forward = block.layer[0], block.layer[-1]
        if update is None:
            h = g.rms_norm(x, attention.layer_norm)
        else:
            h, x = g.skip_rms_norm(x, update, attention.layer_norm)
        heads = attention.SelfAttention
        q, k, v = g.linear(h, heads.q, heads.k, heads.v)
        update = g.linear(g.attention(q, k, v, 1.0, attention_bias=bias), heads.o)
        h, x = g.skip_rms_norm(x, update, feed_forward.layer_norm)
        update = t5_feed_forward(g, h, feed_forward.DenseReluDense)
    return g.skip_rms_norm(x, update, model.encoder.final_layer_norm)[0]


def encoder_graph(path):
    g = Graph()
    g.output(t5_encoder(g), "states")
    g.save(path)


def split_heads(g, x):
    x = g.add("Reshape", [x, g.weight(np.array([1, -1, HEADS, HEAD_DIM]))])
    return g.add("Transpose", [x], perm=[0, 2, 1, 3])


def prefill_graph(path):
    """The encoder, and the decoder's keys and values from its states, computed once."""
    g = Graph()
    states = t5_encoder(g)
    for i, block in enumerate(t5().decoder.block):
        attention = block.layer[1].EncDecAttention
        for name, value in zip("kv", g.linear(states, attention.k, attention.v)):
            g.output(split_heads(g, value), f"cross_{name}{i}")
    g.save(path)


def decoder_graph(path):
    """One greedy pass: the code after the last of a few ids, and the extended keys and values of every layer."""
    model, g = t5(), Graph()
    x = g.add("Gather", [g.weight(model.shared.weight), g.input("ids", [1, "rows"], TensorProto.INT64)])
    bias = g.input("bias", [1, HEADS, "rows", "time"])
    update = None
    for i, block in enumerate(model.decoder.block):
        past = [g.input(f"past_{name}{i}", [1, HEADS, "past", HEAD_DIM]) for name in "kv"]
        cross = [g.input(f"cross_{name}{i}", [1, HEADS, TOKENS, HEAD_DIM]) for name in "kv"]
        attention, cross_attention, feed_forward = block.layer
        if update is None:
            h = g.rms_norm(x, attention.layer_norm)
        else:
            h, x = g.skip_rms_norm(x, update, attention.layer_norm)
        heads = attention.SelfAttention
        q, k, v = g.linear(h, heads.q, heads.k, heads.v)
        y, *present = g.attention(q, k, v, 1.0, 3, attention_bias=bias, past_key=past[0], past_value=past[1])
        for name, value in zip("kv", present):
            g.output(value, f"present_{name}{i}")
        h, x = g.skip_rms_norm(x, g.linear(y, heads.o), cross_attention.layer_norm)
        heads = cross_attention.EncDecAttention
        y = g.attention(g.linear(h, heads.q), *cross, 1.0)
        h, x = g.skip_rms_norm(x, g.linear(y, heads.o), feed_forward.layer_norm)
        update = t5_feed_forward(g, h, feed_forward.DenseReluDense)
    h, _ = g.skip_rms_norm(x, update, model.decoder.final_layer_norm)
    h = g.add("Gather", [h, g.weight(np.array([-1]))], axis=1)
    g.output(g.add("ArgMax", [g.linear(h, model.lm_head)], axis=-1, keepdims=0), "code", TensorProto.INT64)
    g.save(path)


def speech_layers(g, model, x):
    """Layers shared by HuBERT and wav2vec 2.0: samples `[batch, samples]` to features `[batch, tokens, 768]`."""
    x = g.add("Unsqueeze", [x, g.weight(np.array([1]))])
    for i, layer in enumerate(model.feature_extractor.conv_layers):
        x = g.add("Conv", [x, g.weight(layer.conv.weight)], strides=list(layer.conv.stride))
        if i == 0:
            norm = layer.layer_norm
            x = g.add("InstanceNormalization", [x, g.weight(norm.weight), g.weight(norm.bias)], epsilon=norm.eps)
        x = g.add("Gelu", [x])
    x = g.layer_norm(g.add("Transpose", [x], perm=[0, 2, 1]), model.feature_projection.layer_norm)
    x = g.linear(x, model.feature_projection.projection)
    conv = model.encoder.pos_conv_embed.conv
    y = g.add("Transpose", [x], perm=[0, 2, 1])
    # The kernel is even: with padding of 64 on both sides, the last output is dropped.
    y = g.add("Conv", [y, g.weight(conv.weight), g.weight(conv.bias)], group=conv.groups, pads=[64, 63])
    y = g.add("Transpose", [g.add("Gelu", [y])], perm=[0, 2, 1])
    x = g.layer_norm(g.add("Add", [x, y]), model.encoder.layer_norm)
    for layer in model.encoder.layers:
        heads, feed_forward = layer.attention, layer.feed_forward
        q, k, v = g.linear(x, heads.q_proj, heads.k_proj, heads.v_proj)
        y = g.linear(g.attention(q, k, v, HEAD_DIM**-0.5), heads.out_proj)
        x = g.layer_norm(g.add("Add", [x, y]), layer.layer_norm)
        y = g.add("Gelu", [g.linear(x, feed_forward.intermediate_dense)])
        y = g.linear(y, feed_forward.output_dense)
        x = g.layer_norm(g.add("Add", [x, y]), layer.final_layer_norm)
    return x


def hubert_graph(path):
    g = Graph()
    g.output(speech_layers(g, hubert(), g.input("audio", [1, SECONDS * 16_000])), "features")
    g.save(path)


def face_graph(path):
    net, g = face(), Graph()
    windows = g.input("windows", [FACE_FRAMES, FACE_WINDOW])
    emotion = g.input("emotion", [FACE_FRAMES, net.EMOTION])

    def active(x):
        return g.add("Mul", [g.add("Relu", [x]), g.weight(np.float32(2**0.5))])

    def conv(x, layer):
        pads = 2 * list(layer.padding)
        weights = [g.weight(layer.weight), g.weight(layer.bias)]
        return active(g.add("Conv", [x, *weights], strides=list(layer.stride), pads=pads))

    x = g.add("Relu", [g.linear(speech_layers(g, net.speech, windows), net.speech_map)])
    x = g.add("Transpose", [x], perm=[0, 2, 1])
    heard = g.add("Unsqueeze", [x, g.weight(np.array([3]))])
    # All windows' samples by one gather, then every lag.
    at = net.STRIDE * np.arange(net.WINDOWS)[:, None] + np.arange(net.LENGTH)
    x = g.add("Gather", [windows, g.weight(at)], axis=1)
    x = g.add("Sub", [x, g.add("ReduceMean", [x, g.weight(np.array([-1]))])])
    x = g.add("Mul", [x, g.weight(np.hanning(net.LENGTH).astype(np.float32))])

    def part(x, first, last):
        return g.add("Slice", [x, *(g.weight(np.array([value])) for value in (first, last, -1))])

    lags = [
        g.add("ReduceSum", [g.add("Mul", [part(x, 0, net.LENGTH - lag), part(x, lag, net.LENGTH)]), g.weight(np.array([-1]))])
        for lag in range(net.LAGS)
    ]
    x = g.add("Transpose", [g.add("Concat", lags, axis=2)], perm=[0, 1, 2])
    x = g.add("Unsqueeze", [g.add("Mul", [x, g.weight(np.float32(1 / net.LENGTH))]), g.weight(np.array([1]))])
    for layer in net.lags:
        x = conv(x, layer)
    x = g.add("Concat", [heard, x], axis=1)
    wide = g.add("Unsqueeze", [emotion, g.weight(np.array([2, 3]))])
    for rows, layer in zip([13, 7, 4, 2], net.times):
        shape = g.weight(np.array([FACE_FRAMES, net.EMOTION, rows, 1]))
        x = g.add("Concat", [conv(x, layer), g.add("Expand", [wide, shape])], axis=1)
    x = active(g.linear(g.add("Flatten", [x]), net.joined))
    x = g.add("Concat", [x, emotion], axis=1)
    outputs = [g.linear(g.linear(x, first), second) for first, second in (net.skin, net.tongue)]
    g.output(g.add("Concat", outputs, axis=1), "coefficients")
    g.save(path)


def session(path, threads):
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.log_severity_level = 3
    return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])


class OnnxT5:
    """Encoder and greedy decoder in ONNX Runtime, with keys and values kept in its own memory."""

    def __init__(self, folder, kind, threads, passes):
        self.prefill = session(folder / f"prefill.{kind}.onnx", threads)
        self.decoder = session(folder / f"decoder.{kind}.onnx", threads)
        values = [[onnxruntime.OrtValue.ortvalue_from_numpy(bias)] for bias in [encoder_bias(), *decoder_biases(passes)]]
        (self.encoder_bias,), self.biases = values[0], [bias for (bias,) in values[1:]]
        self.passes = passes
        self.empty = onnxruntime.OrtValue.ortvalue_from_numpy(np.zeros((1, HEADS, 0, HEAD_DIM), np.float32))
        self.names = [f"{name}{i}" for i in range(LAYERS) for name in "kv"]

    def run(self, session, inputs):
        binding = session.io_binding()
        for name, value in inputs.items():
            binding.bind_ortvalue_input(name, value)
        for output in session.get_outputs():
            binding.bind_output(output.name)
        session.run_with_iobinding(binding)
        return dict(zip([output.name for output in session.get_outputs()], binding.get_outputs()))

    def chunk(self, ids):
        ids = onnxruntime.OrtValue.ortvalue_from_numpy(ids)
        cross = self.run(self.prefill, {"ids": ids, "bias": self.encoder_bias})
        past = {f"past_{name}": self.empty for name in self.names}
        code, codes = 0, []
        for rows, bias in zip(self.passes, self.biases):
            new = np.array([[code, *MARKERS[: rows - 1]]])
            new = onnxruntime.OrtValue.ortvalue_from_numpy(new)
            found = self.run(self.decoder, {"ids": new, "bias": bias, **cross, **past})
            code = int(found["code"].numpy()[0, 0])
            codes.append(code)
            past = {f"past_{name}": found[f"present_{name}"] for name in self.names}
        return codes


def check_onnx(folder):
    """Checks that the graphs compute the same as the PyTorch models."""
    with torch.inference_mode():
        want = t5().encoder(torch.from_numpy(token_ids())).last_hidden_state.numpy()
        got = session(folder / "encoder.f32.onnx", 2).run(None, {"ids": token_ids(), "bias": encoder_bias()})[0]
        assert np.abs(got - want).max() < 1e-3 * np.abs(want).max(), "the encoder's graph differs"
        states = transformers.modeling_outputs.BaseModelOutput(torch.from_numpy(want))
        for passes in [STEP_ROWS, CHUNK_ROWS]:
            ids, codes = [], [0]
            for rows in passes:
                ids += [codes[-1], *MARKERS[: rows - 1]]
                logits = t5()(encoder_outputs=states, decoder_input_ids=torch.tensor([ids])).logits
                codes.append(int(logits[0, -1].argmax()))
            got = OnnxT5(folder, "f32", 2, passes).chunk(token_ids())
            assert len(set(got)) > 1 and got == codes[1:], "the decoder's graph differs"
        want = hubert()(torch.from_numpy(audio())).last_hidden_state.numpy()
        got = session(folder / "hubert.f32.onnx", 2).run(None, {"audio": audio()})[0]
        assert np.abs(got - want).max() < 1e-3 * np.abs(want).max(), "HuBERT's graph differs"


def check_face(folder):
    with torch.inference_mode():
        want = face()(*map(torch.from_numpy, face_inputs().values())).numpy()
    got = session(folder / "face.f32.onnx", 2).run(None, face_inputs())[0]
    assert np.abs(got - want).max() < 1e-3 * np.abs(want).max(), "the face's graph differs"


GRAPHS = {"encoder": encoder_graph, "prefill": prefill_graph, "decoder": decoder_graph, "hubert": hubert_graph}


def quantized(folder, name):
    source, target = folder / f"{name}.f32.onnx", folder / f"{name}.int8.onnx"
    # Types are not inferred through ONNX Runtime's own operations: all factors are f32.
    options = {"DefaultTensorType": TensorProto.FLOAT}
    quantize_dynamic(
        source, target, op_types_to_quantize=["MatMul"], weight_type=QuantType.QInt8, extra_options=options
    )


def build_onnx(folder):
    for name, graph in GRAPHS.items():
        graph(folder / f"{name}.f32.onnx")
    check_onnx(folder)
    for name in GRAPHS:
        quantized(folder, name)


def build_face(folder):
    face_graph(folder / "face.f32.onnx")
    check_face(folder)
    quantized(folder, "face")


class Tokens:
    """The minimum of a tokenizer that the converter requires: pieces are their own numbers."""

    pad_token, eos_token, unk_token = "0", "1", "2"

    def get_vocab(self):
        return {str(i): i for i in range(HEAD)}

    def convert_ids_to_tokens(self, token):
        return str(token)


def build_ctranslate2(folder):
    import ctranslate2
    from ctranslate2.converters.transformers import T5Loader
    from ctranslate2.specs import TransformerEncoderModelSpec, transformer_spec

    def save(spec, name):
        spec.validate()
        spec.optimize(quantization="int8")
        (folder / name).mkdir(exist_ok=True)
        spec.save(folder / name)

    loader = T5Loader()
    with torch.no_grad():
        # Quantising modifies the arrays of a specification, so build it again.
        save(loader(copy.deepcopy(t5()), Tokens()), "ctranslate2")
        stack = transformer_spec.TransformerEncoderSpec(
            LAYERS, HEADS, activation=transformer_spec.common_spec.Activation.GELUTanh,
            ffn_glu=True, relative_attention_bias=True, rms_norm=True,
        )  # fmt: skip
        spec = TransformerEncoderModelSpec(stack)
        loader.set_stack(spec.encoder, copy.deepcopy(t5()).encoder)
        spec.config.bos_token, spec.config.eos_token, spec.config.unk_token = "0", "1", "2"
        spec.register_vocabulary(list(Tokens().get_vocab()))
        save(spec, "ctranslate2-encoder")

    ids, codes = token_ids(), np.random.default_rng(5).integers(3, HEAD, STEPS)
    encoder = ctranslate2.Encoder(str(folder / "ctranslate2-encoder"))
    states = np.array(encoder.forward_batch(ids.tolist()).last_hidden_state)
    translator = ctranslate2.Translator(str(folder / "ctranslate2"))
    score = translator.score_batch([pieces(ids[0])], [pieces(codes)])[0].log_probs[:STEPS]
    with torch.inference_mode():
        want = t5().encoder(torch.from_numpy(ids)).last_hidden_state.numpy()
        forced = torch.from_numpy(np.concatenate([[0], codes[:-1]]))[None]
        logits = t5()(input_ids=torch.from_numpy(ids), decoder_input_ids=forced).logits[0].log_softmax(-1)
    want_score = logits[torch.arange(STEPS), torch.from_numpy(codes)].numpy()
    assert np.corrcoef(states.ravel(), want.ravel())[0, 1] > 0.99, "CTranslate2's encoder differs"
    assert np.corrcoef(score, want_score)[0, 1] > 0.99, "CTranslate2's decoder differs"


def pieces(ids):
    return [str(i) for i in ids]


def build(folder, part):
    """Makes the files under `folder` that `part` needs and that are missing."""
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    makers = {"onnx-rows": build_onnx, "ctranslate2": build_ctranslate2}
    for name, make in {"onnx-face": build_face}.items() if part == "face" else makers.items():
        done = folder / f"{name}.done"
        if not done.exists():
            make(folder)
            done.touch()
