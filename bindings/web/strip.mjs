// Copies a module without its custom sections, which hold names and debug information: strip.mjs FROM TO.

import { readFile, writeFile } from "node:fs/promises";

const [from, to] = process.argv.slice(2);
const bytes = await readFile(from);
const kept = [bytes.subarray(0, 8)];
for (let at = 8; at < bytes.length; ) {
  const start = at;
  const id = bytes[at++];
  let size = 0;
  for (let shift = 0; ; shift += 7) {
    const byte = bytes[at++];
    size += (byte & 0x7f) * 2 ** shift;
    if (byte < 0x80) break;
  }
  at += size;
  if (id !== 0) kept.push(bytes.subarray(start, at));
}
await WebAssembly.compile(Buffer.concat(kept));
await writeFile(to, Buffer.concat(kept));
