// Runs a program compiled for wasm32-wasip1 with Node's WASI: the runner of `scripts/test/wasm`. Gives it access to the
// repository and the environment.
import { readFile } from "node:fs/promises";
import path from "node:path";
import { fileURLToPath } from "node:url";
import { WASI } from "node:wasi";

const root = path.dirname(path.dirname(path.dirname(fileURLToPath(import.meta.url))));
const [program, ...args] = process.argv.slice(2);
const wasi = new WASI({ version: "preview1", args: [program, ...args], env: process.env, preopens: { [root]: root } });
const module = await WebAssembly.compile(await readFile(program));
const instance = await WebAssembly.instantiate(module, wasi.getImportObject());
process.exitCode = wasi.start(instance);
