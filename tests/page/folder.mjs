// Serves a folder as any web server does.

import { readFile } from "node:fs/promises";
import http from "node:http";
import path from "node:path";

const TYPES = { ".html": "text/html", ".js": "text/javascript", ".wasm": "application/wasm" };

/** Serves `folder` at a free local port: its `address`, and the names that were requested in `asked`. */
export async function serve(folder) {
  const names = [];
  const server = http.createServer(async ({ url }, answer) => {
    const asked = path.normalize(decodeURIComponent(new URL(url, "http://x").pathname));
    const name = asked === "/" ? "index.html" : asked.slice(1);
    names.push(name);
    try {
      const bytes = await readFile(path.join(folder, name));
      answer.writeHead(200, { "content-type": TYPES[path.extname(name)] ?? "application/octet-stream", "content-length": bytes.length });
      answer.end(bytes);
    } catch {
      answer.writeHead(404).end();
    }
  });
  await new Promise((done) => server.listen(0, "127.0.0.1", done));
  return { address: `http://127.0.0.1:${server.address().port}/`, asked: names, close: () => server.close() };
}
