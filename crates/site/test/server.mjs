// A static host for tests: files of a folder with ranges, as any host of files gives them, and the faults of some hosts.

import { createReadStream, statSync } from "node:fs";
import { createServer } from "node:http";
import { extname, join, normalize } from "node:path";

const TYPES = { ".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".wasm": "application/wasm", ".txt": "text/plain" };

/** Serves a folder; `hasRanges` says whether ranges are answered, `delay` how many milliseconds each answer takes. */
export async function serve(folder, { hasRanges = true, delay = 0 } = {}) {
  const asked = [];
  const server = createServer(async (request, response) => {
    const path = normalize(decodeURIComponent(new URL(request.url, "http://host").pathname));
    const file = join(folder, path.endsWith("/") ? `${path}index.html` : path);
    if (delay) await new Promise((done) => setTimeout(done, delay));
    let size;
    try {
      size = statSync(file).size;
    } catch {
      response.writeHead(404).end();
      return;
    }
    const headers = { "content-type": TYPES[extname(file)] ?? "application/octet-stream", etag: `"${size}"` };
    const range = hasRanges && /^bytes=(\d*)-(\d*)$/.exec(request.headers.range ?? "");
    const last = range && range[1] !== "" && range[2] !== "" ? Math.min(Number(range[2]), size - 1) : size - 1;
    const first = !range ? 0 : range[1] === "" ? Math.max(size - Number(range[2]), 0) : Number(range[1]);
    const [start, end] = [first, last];
    asked.push({ path, start, bytes: end - start + 1, method: request.method, isRange: Boolean(range) });
    if (hasRanges) headers["accept-ranges"] = "bytes";
    if (range) headers["content-range"] = `bytes ${start}-${end}/${size}`;
    response.writeHead(range ? 206 : 200, { ...headers, "content-length": end - start + 1 });
    if (request.method === "HEAD" || size === 0) response.end();
    else createReadStream(file, { start, end }).pipe(response);
  });
  await new Promise((done) => server.listen(0, "127.0.0.1", done));
  return { url: `http://127.0.0.1:${server.address().port}/`, asked, close: () => new Promise((done) => { server.closeAllConnections(); server.close(done); }) };
}
