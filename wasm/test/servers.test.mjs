// Files on servers of all kinds: with and without ranges, servers that compress, change files,
// fail, or are slow.

import assert from "node:assert/strict";
import { createServer } from "node:http";
import { join } from "node:path";
import test, { after } from "node:test";
import { gzipSync } from "node:zlib";

import { open } from "../../crates/site/page/spinney/index.js";
import { bytesOf, files, frozen, same } from "./helpers.mjs";

const servers = [];
after(() => servers.forEach((server) => { server.close(); server.closeAllConnections(); }));

/** A server of a file's bytes. `how` is its behaviour. */
async function serve(bytes, how = {}) {
  const state = { bytes, etag: '"1"', requests: [], ...how };
  const server = createServer(async (request, response) => {
    state.requests.push(request.headers.range ?? "");
    if (state.delay) await new Promise((resolve) => setTimeout(resolve, state.delay));
    if (state.respond?.(request, response, state)) return;
    const { length } = state.bytes;
    const range = /^bytes=(\d*)-(\d*)$/.exec(request.headers.range ?? "");
    const headers = {};
    if (state.etag) headers.ETag = state.etag;
    if (range && !state.hasNoRanges) {
      const start = range[1] ? Number(range[1]) : Math.max(0, length - Number(range[2]));
      const end = range[1] && range[2] ? Math.min(Number(range[2]) + 1, length) : length;
      if (start >= length) {
        response.writeHead(416, headers).end();
        return;
      }
      response.writeHead(206, { ...headers, ...(state.hidesRange ? {} : { "Content-Range": `bytes ${start}-${end - 1}/${length}` }), "Content-Length": end - start });
      response.end(state.bytes.subarray(start, end));
      return;
    }
    if (state.compresses) {
      response.writeHead(200, { ...headers, "Content-Encoding": "gzip" });
      response.end(gzipSync(state.bytes));
      return;
    }
    response.writeHead(200, { ...headers, ...(state.hidesLength ? {} : { "Content-Length": length }) });
    response.end(state.bytes);
  });
  servers.push(server);
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  return { url: `http://127.0.0.1:${server.address().port}/file.goblin`, state };
}

const map = bytesOf(join(frozen, "classes.goblin"));
const { made } = files();

test("results from a server, from memory and from a Blob are those from a disk", async () => {
  for (const name of ["classes.goblin", "stack.goblin", "history.autumn", "ball.goblin"]) {
    const path = join(frozen, name);
    const expected = await open(path);
    const { url } = await serve(bytesOf(path));
    for (const source of [url, new URL(url), new Blob([bytesOf(path)]), bytesOf(path), bytesOf(path).buffer, new URL(`file://${path}`)]) {
      const found = await open(source);
      same(found.header, expected.header);
      same(await found.stats(), await expected.stats());
      same(await found.window({ level: 3 }), await expected.window({ level: 3 }));
      assert.deepEqual(found.warnings, []);
      found.close();
    }
  }
});

test("a query takes few batches", async () => {
  const bytes = bytesOf(join(made, "island_classes_packed.goblin"));
  const { url, state } = await serve(bytes);
  const found = await open(url);
  let traffic = { batches: 0 };
  await found.window({ level: 6, progress: (total) => { traffic = total; } });
  assert.ok(traffic.batches <= 2, `${traffic.batches} batches`);
  const count = state.requests.length;
  await found.window({ level: 6 });
  assert.equal(state.requests.length, count, "cached ranges are not fetched again");
});

test("a host without ranges causes a warning, and small files are read completely", async () => {
  for (const how of [{ hasNoRanges: true }, { hasNoRanges: true, hidesLength: true }, { hasNoRanges: true, compresses: true }]) {
    const { url } = await serve(map, how);
    const found = await open(url);
    assert.equal(found.warnings.length, 1);
    assert.match(found.warnings[0], how.compresses ? /compresses/ : /does not serve ranges/);
    same((await found.stats()).cells, (await (await open(map)).stats()).cells);
  }
});

test("the length is requested from a host that hides the range", async () => {
  const { url } = await serve(map, { hidesRange: true });
  const found = await open(url);
  assert.deepEqual(found.warnings, []);
  same(await found.stats(), await (await open(map)).stats());
});

test("large files of such hosts are refused", async () => {
  const huge = { length: 65 * 2 ** 20 };
  const { url } = await serve(map, {
    respond: (_, response) => {
      response.writeHead(200, { "Content-Length": huge.length });
      response.write(map);
      return true;
    },
  });
  await assert.rejects(open(url), { code: "unsupported", message: /too many to read all of it/ });
  const { url: endless } = await serve(map, {
    respond: (_, response) => {
      response.writeHead(200);
      const more = () => { while (!response.destroyed && response.write(Buffer.alloc(2 ** 20)));  };
      response.on("drain", more);
      more();
      return true;
    },
  });
  await assert.rejects(open(endless), { code: "unsupported", message: /too many to read all of it/ });
});

test("a file that changes in between is an error that says so, and refresh opens it again", async () => {
  const elevation = bytesOf(join(frozen, "elevation.goblin"));
  for (const change of [
    (state) => { state.etag = '"2"'; },
    (state) => { state.bytes = elevation; state.etag = undefined; },
    (state) => { state.bytes = map.subarray(0, 3000); state.etag = undefined; },
  ]) {
    const { url, state } = await serve(map, { respond: undefined });
    const found = await open(url, { cacheBytes: 2 ** 20 });
    change(state);
    // (The small file was fetched completely when it was opened: another dataset requests its
    // records again.)
    const { url: slow, state: later } = await serve(map);
    const other = await open(slow);
    assert.equal(await other.refresh(), false);
    later.etag = '"3"';
    assert.equal(await other.refresh(), true);
    same((await other.stats()).cells, (await (await open(map)).stats()).cells);
    found.close();
  }
  const large = bytesOf(join(made, "island_elevation.goblin"));
  for (const [change, pattern] of [
    [(state) => { state.etag = '"2"'; }, /was replaced/],
    [(state) => { state.bytes = large.subarray(0, large.length - 7); }, /another length/],
    [(state) => { state.respond = (_, response) => { response.writeHead(404).end(); return true; }; }, /was removed/],
  ]) {
    const { url, state } = await serve(large);
    const found = await open(url);
    change(state);
    await assert.rejects(found.window(), { code: "changed", message: pattern });
  }
});

test("commits that are appended meanwhile leave readers alone", async () => {
  const bytes = bytesOf(join(made, "island_elevation.autumn"));
  const { url, state } = await serve(bytes);
  const found = await open(url);
  state.bytes = Buffer.concat([bytes, Buffer.alloc(4096)]);
  state.etag = '"2"';
  same(await found.stats(), await (await open(bytes)).stats());
  same(await found.window(), await (await open(bytes)).window());
});

test("requests to busy hosts are retried; other failures are errors", async () => {
  let failures = 2;
  const { url } = await serve(map, { respond: (_, response) => { if (failures-- <= 0) return false; response.writeHead(503).end(); return true; } });
  await open(url);
  const { url: missing } = await serve(map, { respond: (_, response) => { response.writeHead(404).end(); return true; } });
  await assert.rejects(open(missing), { code: "not-found", message: /no such file/ });
  const { url: refused } = await serve(map, { respond: (_, response) => { response.writeHead(403).end(); return true; } });
  await assert.rejects(open(refused), { code: "io", message: /403/ });
  const { url: page } = await serve(Buffer.from("<!doctype html><title>not found</title>"));
  await assert.rejects(open(page), (error) => error.name === "SpinneyError");
});

test("a query is aborted between batches and during one", async () => {
  const large = bytesOf(join(made, "island_elevation.goblin"));
  const { url, state } = await serve(large);
  const found = await open(url);
  const before = new AbortController();
  before.abort();
  await assert.rejects(found.window({ signal: before.signal }), { name: "AbortError" });
  state.delay = 2000;
  const control = new AbortController();
  const start = Date.now();
  const pending = found.window({ signal: control.signal });
  setTimeout(() => control.abort(), 50);
  await assert.rejects(pending, { name: "AbortError" });
  assert.ok(Date.now() - start < 1500, "at once");
  state.delay = 0;
  same((await found.stats()).cells, (await (await open(large)).stats()).cells);
  await assert.rejects(open(url, { signal: before.signal }), { name: "AbortError" });
});

test("a query that needs more bytes than the cache holds succeeds", async () => {
  const path = join(made, "island_elevation.goblin");
  const { url } = await serve(bytesOf(path));
  const found = await open(url, { cacheBytes: 1 });
  same(await found.window(), await (await open(path)).window());
});

test("custom headers are sent", async () => {
  const { url } = await serve(map, {
    respond: (request, response) => {
      if (request.headers.authorization === "Bearer secret") return false;
      response.writeHead(401).end();
      return true;
    },
  });
  await assert.rejects(open(url), { message: /401/ });
  await open(url, { headers: { Authorization: "Bearer secret" } });
});
