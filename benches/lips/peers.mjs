// Runs the peers that are JavaScript: `node peers.mjs FOLDER JOB.json`. FOLDER holds their node_modules. The job has
// `recordings`: name, pcm48 and pcm16 (files of 32-bit floats at 48 and 16 kHz) and text; `vowels`: files at 48 kHz by
// vowel; and `output`. Writes for each method and recording times, weights of visemes by name, and CPU seconds.
//
// Peers for browsers get the clock of one: audio in blocks of 128 samples at 48 kHz, a picture 60 times a second, and no
// other delay.
import { readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";

const RATE = 48000;
const BLOCK = 128;
const PICTURES = 60;
const [folder, jobFile] = process.argv.slice(2);
const require = createRequire(pathToFileURL(`${folder}/package.json`));
const { recordings, vowels, withRhubarb, output } = JSON.parse(readFileSync(jobFile, "utf8"));

const floats = (path) => {
    const bytes = readFileSync(path);
    return new Float32Array(bytes.buffer, bytes.byteOffset, bytes.byteLength / 4);
};
const installed = (path) => `${folder}/node_modules/${path}`;
const load = (path) => import(pathToFileURL(installed(path)));

// The globals of the two halves of an AudioWorklet. Messages arrive at once.
const processors = {};
globalThis.sampleRate = RATE;
globalThis.currentTime = 0;
globalThis.registerProcessor = (name, type) => (processors[name] = type);
let ports = [];
const connect = () => {
    const sides = [{ onmessage: null }, { onmessage: null }];
    sides.forEach((side, i) => (side.postMessage = (data) => sides[1 - i].onmessage?.({ data })));
    return sides;
};
globalThis.AudioWorkletProcessor = class {
    constructor() {
        this.port = ports[1];
    }
};
globalThis.AudioWorkletNode = class {
    constructor(context, name, options = {}) {
        ports = connect();
        this.port = ports[0];
        this.processor = new processors[name](options);
        const described = processors[name].parameterDescriptors;
        const values = options.parameterData ?? {};
        this.parameters = new Map(described.map((one) => [one.name, { value: values[one.name] ?? one.defaultValue }]));
    }
    process(block) {
        const parameters = [...this.parameters].map(([name, { value }]) => [name, Float32Array.of(value)]);
        this.processor.process([[block]], [], Object.fromEntries(parameters));
    }
};

// Pictures of a recording: before each, `hear` gets the blocks that have ended by then.
function play(samples, hear, picture) {
    const times = [];
    const weights = [];
    let heard = 0;
    for (let i = 0; i * RATE < samples.length * PICTURES; i++) {
        for (; heard + BLOCK <= Math.min((i * RATE) / PICTURES, samples.length); heard += BLOCK) {
            globalThis.currentTime = heard / RATE;
            hear(samples.subarray(heard, heard + BLOCK));
        }
        times.push(i / PICTURES);
        weights.push(picture(i / PICTURES));
    }
    return { times, weights };
}

const short = (name) => name.replace("viseme_", "");

async function headAudio() {
    await load("@met4citizen/headaudio/dist/headworklet.min.mjs");
    const { HeadAudio } = await load("@met4citizen/headaudio/dist/headaudio.min.mjs");
    const fetched = globalThis.fetch;
    globalThis.fetch = async (path) => new Response(readFileSync(path));
    const run = async ({ pcm48 }) => {
        const node = new HeadAudio({}, { processorOptions: {}, parameterData: {} });
        await node.loadModel(installed("@met4citizen/headaudio/dist/model-en-mixed.bin"));
        const shown = {};
        node.onvalue = (name, value) => (shown[short(name)] = value);
        return play(floats(pcm48), (block) => node.process(block), () => {
            node.update(1000 / PICTURES);
            return { ...shown };
        });
    };
    return { HeadAudio: run, restore: () => (globalThis.fetch = fetched) };
}

async function wLipSync() {
    await load("wlipsync/dist/audio-processor.js");
    const { configuration, createWLipSyncNode } = await load("wlipsync/dist/wlipsync.js");
    configuration.wasmModule = new WebAssembly.Module(readFileSync(installed("wlipsync/dist/wlipsync.wasm")));
    const profile = await calibrated(configuration.wasmModule);
    return {
        wLipSync: async ({ pcm48 }) => {
            const node = await createWLipSyncNode({ sampleRate: RATE }, profile);
            while (!node.processor.exports) await new Promise(setImmediate);
            return play(floats(pcm48), (block) => node.process(block), () => {
                const entries = Object.entries(node.weights).map(([name, weight]) => [name, weight * node.volume]);
                return Object.fromEntries(entries);
            });
        },
    };
}

// uLipSync's calibration: the package has no profile, so its own code hears a recording of each vowel, and its cepstra,
// spread over the recording, become the profile. Settings are uLipSync's defaults.
async function calibrated(module) {
    const [targetSampleRate, sampleCount, channels, l2, count, coefficients] = [16000, 1024, 30, 1, 16, 12];
    const memory = new WebAssembly.Memory({ initial: 4 });
    const { exports } = await WebAssembly.instantiate(module, { env: { memory } });
    exports.load_profile(targetSampleRate, sampleCount, channels, l2, 1, count, 0);
    exports.set_input(RATE);
    const size = exports.get_input_buffer_size();
    const input = new Float32Array(memory.buffer, exports.get_input_buffer(), size);
    const mfccs = Object.entries(vowels).map(([name, path]) => {
        const samples = floats(path);
        const mfccCalibrationDataList = Array.from({ length: count }, (_, i) => {
            const start = Math.floor(((samples.length - size) * i) / (count - 1));
            input.set(samples.subarray(start, start + size));
            exports.execute(0);
            return { array: [...new Float32Array(memory.buffer, exports.mfccOut.value, coefficients)] };
        });
        return { name, mfccCalibrationDataList };
    });
    return { targetSampleRate, sampleCount, melFilterBankChannels: channels, compareMethod: l2, mfccNum: coefficients,
        mfccDataCount: count, useStandardization: false, mfccs };
}

// An AnalyserNode by the Web Audio specification: Blackman's window, magnitudes of the transform over its size, smoothed
// over time, decibels scaled to bytes.
class Analyser {
    smoothing = 0.8;
    minimum = -100;
    maximum = -30;
    set fftSize(size) {
        this.size = size;
        this.frequencyBinCount = size / 2;
        this.latest = new Float32Array(size);
        this.smoothed = new Float64Array(size / 2);
        const turn = (i) => (2 * Math.PI * i) / size;
        this.window = Float64Array.from({ length: size }, (_, i) => 0.42 - 0.5 * Math.cos(turn(i)) + 0.08 * Math.cos(2 * turn(i)));
        this.cosine = Float64Array.from({ length: size / 2 }, (_, i) => Math.cos(turn(i)));
        this.sine = Float64Array.from({ length: size / 2 }, (_, i) => -Math.sin(turn(i)));
    }
    hear(block) {
        this.latest.copyWithin(0, block.length);
        this.latest.set(block, this.size - block.length);
    }
    getByteFrequencyData(bytes) {
        const { size, smoothing, minimum, maximum } = this;
        const real = Float64Array.from(this.latest, (x, i) => x * this.window[i]);
        const imaginary = new Float64Array(size);
        this.transform(real, imaginary);
        for (let k = 0; k < bytes.length; k++) {
            const magnitude = Math.hypot(real[k], imaginary[k]) / size;
            this.smoothed[k] = smoothing * this.smoothed[k] + (1 - smoothing) * magnitude;
            const decibels = 20 * Math.log10(this.smoothed[k]);
            bytes[k] = Math.max(0, Math.min(255, Math.floor((255 / (maximum - minimum)) * (decibels - minimum))));
        }
    }
    transform(real, imaginary) {
        const { size } = this;
        for (let i = 1, j = 0; i < size; i++) {
            let bit = size >> 1;
            for (; j & bit; bit >>= 1) j ^= bit;
            j ^= bit;
            if (i < j) [real[i], real[j]] = [real[j], real[i]];
        }
        for (let half = 1; half < size; half *= 2) {
            for (let start = 0; start < size; start += 2 * half) {
                for (let k = 0; k < half; k++) {
                    const [a, b, turn] = [start + k, start + k + half, (k * size) / (2 * half)];
                    const x = real[b] * this.cosine[turn] - imaginary[b] * this.sine[turn];
                    const y = real[b] * this.sine[turn] + imaginary[b] * this.cosine[turn];
                    [real[b], imaginary[b]] = [real[a] - x, imaginary[a] - y];
                    real[a] += x;
                    imaginary[a] += y;
                }
            }
        }
    }
}

async function wawa() {
    let analyser;
    globalThis.window = {
        AudioContext: class {
            sampleRate = RATE;
            createAnalyser = () => (analyser = new Analyser());
        },
    };
    const { Lipsync, VISEMES } = await load("wawa-lipsync/dist/wawa-lipsync.es.js");
    const clock = performance.now;
    return {
        "wawa-lipsync": async ({ pcm48 }) => {
            let now = 0;
            performance.now = () => now;
            const lipsync = new Lipsync();
            const shown = Object.fromEntries(Object.values(VISEMES).map((name) => [short(name), 0]));
            const made = play(floats(pcm48), (block) => analyser.hear(block), (time) => {
                now = 1000 * time;
                lipsync.processAudio();
                // The easing of the package's own example.
                const isVowel = lipsync.state === "vowel";
                for (const name in shown) {
                    const isActive = name === short(lipsync.viseme);
                    shown[name] += ((isActive ? 1 : 0) - shown[name]) * (isActive ? 0.2 : 0.1) * (isVowel ? 1 : 2);
                }
                return { ...shown };
            });
            performance.now = clock;
            return made;
        },
        // Rhubarb takes it for a browser's.
        restore: () => delete globalThis.window,
    };
}

async function rhubarb() {
    const { Rhubarb } = await load("rhubarb-lip-sync-wasm/dist/index.js");
    const run = (isTold) => async ({ pcm16, text }) => {
        if (isTold && !text) return null;
        const pcm = Buffer.from(Int16Array.from(floats(pcm16), (x) => Math.max(-32768, Math.min(32767, Math.round(x * 32767)))).buffer);
        const { mouthCues } = await Rhubarb.getLipSync(pcm, isTold ? { dialogText: text } : {});
        // A drawing lasts until the next; as published, some cues begin before the end of the one before.
        const ends = [...mouthCues.slice(1).map(({ start }) => start), mouthCues.at(-1).end];
        const steps = mouthCues.flatMap(({ start, value }, i) => [[start, value], [ends[i] - 1e-3, value]]);
        return { times: steps.map(([time]) => time), weights: steps.map(([, value]) => ({ [value]: 1 })) };
    };
    return { Rhubarb: run(false), "Rhubarb, told the text": run(true) };
}

const results = {};
for (const peer of [headAudio, wLipSync, wawa, ...(withRhubarb ? [rhubarb] : [])]) {
    const { restore, ...methods } = await peer();
    for (const [method, run] of Object.entries(methods)) {
        results[method] = {};
        for (const recording of recordings) {
            const before = process.cpuUsage();
            const made = await run(recording);
            const { user, system } = process.cpuUsage(before);
            if (made) results[method][recording.name] = { ...made, cpu: (user + system) / 1e6 };
        }
    }
    restore?.();
}
writeFileSync(output, JSON.stringify(results));
