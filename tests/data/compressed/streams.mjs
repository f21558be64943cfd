// Prints streams that meshoptimizer compressed, and what its own decoder makes of them, one per line: mode, filter, number of
// elements, bytes per element, stream and elements in base 64.
//
// npm install meshoptimizer@1.3, then in its folder: node streams.mjs > streams.txt

import { MeshoptDecoder, MeshoptEncoder } from "meshoptimizer";

await MeshoptDecoder.ready;
await MeshoptEncoder.ready;

let state = 1;
function random() {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
}

const text = (bytes) => Buffer.from(bytes).toString("base64");

function print(mode, filter, count, stride, stream) {
    const elements = new Uint8Array(count * stride);
    MeshoptDecoder.decodeGltfBuffer(elements, count, stride, stream, mode, filter);
    console.log(mode, filter, count, stride, text(stream), text(elements));
}

// Smooth data needs few bits per delta, noise needs all of them.
function elements(count, stride, noise) {
    const bytes = new Uint8Array(count * stride);
    for (let i = 0; i < bytes.length; i++) {
        const smooth = i < stride ? 100 : bytes[i - stride] + Math.round(4 * random() - 2);
        bytes[i] = random() < noise ? 256 * random() : smooth;
    }
    return bytes;
}

const bytes = [[1, 4, 0], [17, 4, 0.1], [31, 8, 1], [40, 12, 0.02], [300, 4, 0.05]].map(([count, stride, noise]) => [
    count, stride, elements(count, stride, noise),
]);
const words = new Uint8Array(Uint16Array.from({ length: 80 }, (_, i) => 300 * i + 40 * random()).buffer);
const waves = new Uint8Array(Float32Array.from({ length: 80 }, (_, i) => Math.sin(i / 9)).buffer);
// Single bits that flip are best stored as XOR.
const flags = new Uint8Array(Uint32Array.from({ length: 64 }, () => 0x0f0f0f0f ^ (Math.floor(4 * random()) << 14)).buffer);
for (const [count, stride, source] of [...bytes, [40, 4, words], [40, 8, waves], [64, 4, flags]]) {
    for (const [version, level] of [[0, 0], [1, 0], [1, 2], [1, 3]]) {
        print("ATTRIBUTES", "NONE", count, stride, MeshoptEncoder.encodeVertexBufferLevel(source, count, stride, level, version));
    }
}
// More than one block.
print("ATTRIBUTES", "NONE", 35, 256, MeshoptEncoder.encodeVertexBufferLevel(elements(35, 256, 0), 35, 256, 2, 1));

const filtered = (filter, count, stride, bytes) =>
    print("ATTRIBUTES", filter, count, stride, MeshoptEncoder.encodeVertexBufferLevel(bytes, count, stride, 2, 1));
const floats = (count, make) => Float32Array.from({ length: 4 * count }, (_, i) => make(i));
const units = (count) => {
    const out = floats(count, () => 2 * random() - 1);
    for (let i = 0; i < out.length; i += 4) {
        const length = Math.hypot(out[i], out[i + 1], out[i + 2], out[i + 3]);
        for (let k = 0; k < 4; k++) out[i + k] /= length;
    }
    return out;
};
const directions = (count) => {
    const out = units(count);
    for (let i = 0; i < out.length; i += 4) {
        const length = Math.hypot(out[i], out[i + 1], out[i + 2]);
        for (let k = 0; k < 3; k++) out[i + k] /= length;
        out[i + 3] = 1;
    }
    return out;
};
for (const bits of [4, 8]) filtered("OCTAHEDRAL", 20, 4, MeshoptEncoder.encodeFilterOct(directions(20), 20, 4, bits));
for (const bits of [10, 16]) filtered("OCTAHEDRAL", 20, 8, MeshoptEncoder.encodeFilterOct(directions(20), 20, 8, bits));
for (const bits of [8, 16]) filtered("QUATERNION", 20, 8, MeshoptEncoder.encodeFilterQuat(units(20), 20, 8, bits));
for (const bits of [4, 15, 24])
    filtered("EXPONENTIAL", 20, 16, MeshoptEncoder.encodeFilterExp(floats(20, () => 1e4 * random() ** 9 - 1), 20, 16, bits));
for (const [stride, bits] of [[4, 5], [4, 8], [8, 10], [8, 16]])
    filtered("COLOR", 20, stride, MeshoptEncoder.encodeFilterColor(floats(20, random), 20, stride, bits));

const grid = [];
for (let y = 0; y < 7; y++)
    for (let x = 0; x < 7; x++) grid.push(8 * y + x, 8 * y + x + 1, 8 * y + x + 8, 8 * y + x + 8, 8 * y + x + 1, 8 * y + x + 9);
const noise = Array.from({ length: 60 }, () => Math.floor(40 * random()));
// Two independent meshes, the second of which begins again at vertex 0.
for (const [list, stride] of [[grid, 2], [noise, 2], [[...grid, ...noise, ...grid], 4], [noise.map((i) => 1e5 * i), 4]]) {
    const typed = stride == 2 ? Uint16Array.from(list) : Uint32Array.from(list);
    const bytes = new Uint8Array(typed.buffer);
    print("TRIANGLES", "NONE", list.length, stride, MeshoptEncoder.encodeIndexBuffer(bytes, list.length, stride));
    print("INDICES", "NONE", list.length, stride, MeshoptEncoder.encodeIndexSequence(bytes, list.length, stride));
}
