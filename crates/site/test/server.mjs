// A static file host for tests: serves a directory with range requests, as most hosts do. Options
// simulate hosts without ranges and slow connections.

import { closeSync, openSync, readFileSync, readSync, readdirSync, statSync } from "node:fs";
import { createServer } from "node:http";
import { extname, join, normalize } from "node:path";
import { gzipSync } from "node:zlib";

const TYPES = { ".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".wasm": "application/wasm", ".txt": "text/plain" };

/** Bytes `start` to `end` (inclusive) of a file. */
function part(file, start, end) {
  const bytes = Buffer.alloc(end - start + 1);
  const handle = openSync(file, "r");
  readSync(handle, bytes, 0, bytes.length, start);
  closeSync(handle);
  return bytes;
}

/**
 * Serves a directory. `hasRanges`: range requests are supported; `delay`: latency of each response
 * in milliseconds; `bytesPerSecond`: total bandwidth of all responses; `packs`: file types in
 * `TYPES` are compressed by gzip. Returns the `url`, the requests so far (`requests`) and `close`.
 */
export async function serve(directory, { hasRanges = true, delay = 0, bytesPerSecond = Infinity, packs = false } = {}) {
  // (Time at which the simulated connection is free, as `performance.now()`.)
  let free = 0;
  const packed = new Map();
  const packOnce = (file) => packed.get(file) ?? packed.set(file, gzipSync(readFileSync(file))).get(file);
  // (Hosts compress files before they are requested.)
  const files = packs ? readdirSync(directory, { recursive: true }) : [];
  files.filter((name) => extname(name) in TYPES).forEach((name) => packOnce(join(directory, name)));
  const requests = [];
  const server = createServer(async (request, response) => {
    const path = normalize(decodeURIComponent(new URL(request.url, "http://host").pathname));
    const file = join(directory, path.endsWith("/") ? `${path}index.html` : path);
    if (delay) await new Promise((done) => setTimeout(done, delay));
    let size;
    try {
      size = statSync(file).size;
    } catch {
      response.writeHead(404).end();
      return;
    }
    const range = hasRanges && /^bytes=(\d*)-(\d*)$/.exec(request.headers.range ?? "");
    const end = range && range[1] !== "" && range[2] !== "" ? Math.min(Number(range[2]), size - 1) : size - 1;
    const start = !range ? 0 : range[1] === "" ? Math.max(size - Number(range[2]), 0) : Number(range[1]);
    const headers = { "content-type": TYPES[extname(file)] ?? "application/octet-stream", etag: `"${size}"` };
    if (hasRanges) headers["accept-ranges"] = "bytes";
    if (range) headers["content-range"] = `bytes ${start}-${end}/${size}`;
    const isPacked = packs && !range && extname(file) in TYPES;
    if (isPacked) headers["content-encoding"] = "gzip";
    const body = request.method === "HEAD" || size === 0 ? Buffer.alloc(0) : isPacked ? packOnce(file) : part(file, start, end);
    headers["content-length"] = request.method === "HEAD" ? end - start + 1 : body.length;
    requests.push({ path, start, bytes: end - start + 1, sent: body.length });
    if (bytesPerSecond < Infinity) {
      free = Math.max(free, performance.now()) + (body.length / bytesPerSecond) * 1000;
      await new Promise((done) => setTimeout(done, free - performance.now()));
    }
    response.writeHead(range ? 206 : 200, headers).end(body);
  });
  await new Promise((done) => server.listen(0, "127.0.0.1", done));
  return { url: `http://127.0.0.1:${server.address().port}/`, requests, close: () => new Promise((done) => { server.closeAllConnections(); server.close(done); }) };
}
