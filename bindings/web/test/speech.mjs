// Reads a mono 16-bit WAV file as float samples.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";

export async function speech(url) {
  const bytes = await readFile(url);
  const at = bytes.indexOf("data");
  assert.ok(bytes.toString("latin1", 0, 4) === "RIFF" && at > 0);
  const length = bytes.readUInt32LE(at + 4) / 2;
  return Float32Array.from({ length }, (_, i) => bytes.readInt16LE(at + 8 + 2 * i) / 32_768);
}
