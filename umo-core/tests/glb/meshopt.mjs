// Writes meshopt.json: streams of the npm package `meshoptimizer`, and its decoder's output for them.
//
//     npm install meshoptimizer && node meshopt.mjs > meshopt.json

import { MeshoptDecoder, MeshoptEncoder } from 'meshoptimizer';

await MeshoptDecoder.ready;
await MeshoptEncoder.ready;

let state = 1;
const random = () => (state = (state * 48271) % 2147483647) / 2147483647;
const base64 = (bytes) => Buffer.from(bytes.buffer, bytes.byteOffset, bytes.byteLength).toString('base64');
const cases = [];

function add(mode, count, size, source, filter) {
    const encoded = MeshoptEncoder.encodeGltfBuffer(source, count, size, mode, 0);
    const decoded = new Uint8Array(count * size);
    MeshoptDecoder.decodeGltfBuffer(decoded, count, size, encoded, mode, filter);
    cases.push({ mode, count, size, filter: filter ?? 'NONE', data: base64(encoded), values: base64(decoded) });
}

// Smooth, noisy and constant bytes, so that groups of every width occur; more than one block of vertices.
const vertices = new Uint8Array(300 * 12);
for (let at = 0; at < vertices.length; at++) {
    const vertex = Math.floor(at / 12);
    vertices[at] = [vertex / 3, 7, vertex * 5, random() * 256, vertex % 97 ? 3 : 200, random() * 5][at % 6];
}
add('ATTRIBUTES', 300, 12, vertices);
add('ATTRIBUTES', 5, 64, vertices.slice(0, 320));

// A grid, a zigzag strip, and random triangles.
const corners = [];
for (let y = 0; y < 9; y++) {
    for (let x = 0; x < 9; x++) {
        const at = y * 10 + x;
        corners.push(at, at + 1, at + 10, at + 10, at + 1, at + 11);
    }
}
for (let at = 0; at < 90; at++) corners.push(Math.floor(random() * 70000));
for (let at = 0; at < 30; at++) corners.push(at, at + 1, at + 2);
const triangles = new Uint32Array(corners);
add('TRIANGLES', triangles.length, 4, new Uint8Array(triangles.buffer));
const small = new Uint16Array(corners.slice(0, 486));
add('TRIANGLES', small.length, 2, new Uint8Array(small.buffer));
add('INDICES', triangles.length, 4, new Uint8Array(triangles.buffer));

const numbers = new Float32Array(40 * 4).map(() => 2 * random() - 1);
for (let at = 0; at < 160; at += 4) {
    const length = Math.hypot(...numbers.subarray(at, at + 4));
    for (let part = at; part < at + 4; part++) numbers[part] /= length;
}
add('ATTRIBUTES', 40, 4, MeshoptEncoder.encodeFilterOct(numbers, 40, 4, 8), 'OCTAHEDRAL');
add('ATTRIBUTES', 40, 8, MeshoptEncoder.encodeFilterOct(numbers, 40, 8, 12), 'OCTAHEDRAL');
add('ATTRIBUTES', 40, 8, MeshoptEncoder.encodeFilterQuat(numbers, 40, 8, 12), 'QUATERNION');
add('ATTRIBUTES', 40, 16, MeshoptEncoder.encodeFilterExp(numbers, 40, 16, 15), 'EXPONENTIAL');

console.log('[\n' + cases.map((made) => JSON.stringify(made)).join(',\n') + '\n]');
