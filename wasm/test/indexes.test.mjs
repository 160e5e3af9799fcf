// Indexes: cells that are in GeoTIFF files, on disks and servers.

import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import { readFileSync, rmSync, writeFileSync } from "node:fs";
import { createServer } from "node:http";
import { join } from "node:path";
import test, { after } from "node:test";
import { promisify } from "node:util";
import { Worker } from "node:worker_threads";
import { deflateSync } from "node:zlib";

import { open, openInWorker, setWorker } from "../../crates/site/page/spinney/index.js";
import * as engine from "../../crates/site/page/spinney/engine.js";
import { program, random, root, same, serve as serveByProgram, spinney, temporaryDirectory } from "./helpers.mjs";

const directory = temporaryDirectory();
const at = (name) => join(directory, name);
const servers = [];
after(() => servers.forEach((server) => { server.close(); server.closeAllConnections(); }));

/** LZW of TIFF with literals alone: the table is cleared before codes have ten bits. */
function lzw(bytes) {
  const codes = [];
  bytes.forEach((byte, place) => {
    if (place % 200 === 0) codes.push(256);
    codes.push(byte);
  });
  codes.push(257);
  const packed = Buffer.alloc(Math.ceil((9 * codes.length) / 8));
  codes.forEach((code, place) => {
    for (let bit = 0; bit < 9; bit += 1) {
      const to = 9 * place + bit;
      if (code & (1 << (8 - bit))) packed[to >> 3] |= 0x80 >> (to & 7);
    }
  });
  return packed;
}

const COMPRESSIONS = { none: [1, (bytes) => bytes], lzw: [5, lzw], deflate: [8, (bytes) => deflateSync(bytes)] };

/** Writes a TIFF of one channel in tiles of 64 pixels; returns the offsets of the tiles. */
function writeTiff(name, samples, width, height, compression) {
  const [number, compress] = COMPRESSIONS[compression];
  const size = samples.BYTES_PER_ELEMENT;
  const tiles = [];
  for (let top = 0; top < height; top += 64) {
    for (let left = 0; left < width; left += 64) {
      const tile = new samples.constructor(64 * 64);
      for (let row = top; row < Math.min(top + 64, height); row += 1) {
        tile.set(samples.subarray(row * width + left, row * width + Math.min(left + 64, width)), 64 * (row - top));
      }
      tiles.push(compress(Buffer.from(tile.buffer)));
    }
  }
  return writeChunks(name, { 256: [width], 257: [height], 258: [8 * size], 259: [number], 262: [1], 277: [1], 322: [64], 323: [64], 339: [samples instanceof Int16Array ? 2 : 1] }, [324, 325], tiles);
}

/** Writes a TIFF of these tags and chunks, and a transform of pixels of 30 metres in EPSG:32628. */
function writeChunks(name, tags, [offsets, lengths], chunks) {
  let end = 8;
  const starts = chunks.map((chunk) => (end += chunk.length) - chunk.length);
  const keys = [1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 32628];
  const all = { ...tags, [offsets]: starts, [lengths]: chunks.map((chunk) => chunk.length), 33550: [30, 30, 0], 33922: [0, 0, 0, 300000, 3200000, 0], 34735: keys };
  const numbers = Object.keys(all).map(Number).sort((a, b) => a - b);
  const head = Buffer.from("II*\0\0\0\0\0", "latin1");
  head.writeUInt32LE(end, 4);
  const list = Buffer.alloc(2 + 12 * numbers.length + 4);
  list.writeUInt16LE(numbers.length);
  const values = [];
  let next = end + list.length;
  numbers.forEach((tag, index) => {
    const isDouble = tag === 33550 || tag === 33922;
    const type = isDouble ? 12 : tag === 34735 || tag === 258 || tag === 530 ? 3 : 4;
    const width = { 3: 2, 4: 4, 12: 8 }[type];
    const value = Buffer.alloc(Math.max(4, width * all[tag].length));
    all[tag].forEach((number, place) => {
      if (type === 12) value.writeDoubleLE(number, 8 * place);
      else value.writeUIntLE(number, width * place, width);
    });
    list.writeUInt16LE(tag, 2 + 12 * index);
    list.writeUInt16LE(type, 4 + 12 * index);
    list.writeUInt32LE(all[tag].length, 6 + 12 * index);
    if (value.length === 4) {
      value.copy(list, 10 + 12 * index);
    } else {
      list.writeUInt32LE(next, 10 + 12 * index);
      values.push(value);
      next += value.length;
    }
  });
  writeFileSync(at(name), Buffer.concat([head, ...chunks, list, ...values]));
  return starts;
}

/** A server of the directory's files. `state` is its behaviour, and the requests. */
async function serve(state = {}) {
  state.requests = [];
  const server = createServer((request, response) => {
    const name = decodeURIComponent(request.url.slice(1).split("?")[0]);
    state.requests.push({ name, range: request.headers.range, token: request.headers.authorization });
    let bytes;
    try {
      bytes = readFileSync(at(name));
    } catch {
      response.writeHead(404).end();
      return;
    }
    const headers = { ETag: state.etag ?? '"1"' };
    const range = /^bytes=(\d*)-(\d*)$/.exec(request.headers.range ?? "");
    if (!range || state.hasNoRanges?.test(name)) {
      response.writeHead(200, { ...headers, "Content-Length": bytes.length }).end(request.method === "HEAD" ? undefined : bytes);
      return;
    }
    const start = range[1] ? Number(range[1]) : Math.max(0, bytes.length - Number(range[2]));
    const end = range[1] && range[2] ? Math.min(Number(range[2]) + 1, bytes.length) : bytes.length;
    if (start >= end) {
      response.writeHead(416, headers).end();
      return;
    }
    response.writeHead(206, { ...headers, "Content-Range": `bytes ${start}-${end - 1}/${bytes.length}`, "Content-Length": end - start });
    response.end(bytes.subarray(start, end));
  });
  servers.push(server);
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  return `http://127.0.0.1:${server.address().port}/`;
}

/** Makes an index while this process serves its sources. */
const index = (...list) => promisify(execFile)(program, ["index", "-q", ...list]);

/** Warnings on the console while work is done. */
async function warningsOf(work) {
  const { warn } = console;
  const warnings = [];
  console.warn = (text) => warnings.push(text);
  try {
    await work();
  } finally {
    console.warn = warn;
  }
  return warnings;
}

const [WIDTH, HEIGHT] = [700, 530];
const next = random(7);
const cells = (make) => Array.from({ length: WIDTH * HEIGHT }, (_, cell) => make(cell % WIDTH, Math.floor(cell / WIDTH)));
const classes = Uint8Array.from(cells((x, y) => 1 + ((x >> 4) + (y >> 5)) % 5 + (next() < 0.1 ? 1 : 0)));
const heights = Int16Array.from(cells((x, y) => 300 * Math.sin(x / 40) * Math.cos(y / 50) + 20 * next()));

writeTiff("classes_none.tif", classes, WIDTH, HEIGHT, "none");
writeTiff("heights_none.tif", heights, WIDTH, HEIGHT, "none");
const kinds = { classes: "categorical", heights: "continuous" };
for (const [kind, samples] of [["classes", classes], ["heights", heights]]) {
  const meaning = ["--kind", kinds[kind]];
  spinney("build", "-q", at(`${kind}_none.tif`), "-o", at(`${kind}.goblin`), ...meaning);
  for (const compression of ["lzw", "deflate"]) writeTiff(`${kind}_${compression}.tif`, samples, WIDTH, HEIGHT, compression);
  spinney("export", "-q", at(`${kind}.goblin`), "-o", at(`${kind}_zstd.tif`), "--compression", "zstd", "--tile-size", 256);
  for (const compression of ["none", "lzw", "deflate", "zstd"]) {
    spinney("index", "-q", at(`${kind}_${compression}.tif`), "-o", at(`${kind}_${compression}.goblin`), ...meaning);
  }
}

function sameWindow({ data, mask, ...found }, { data: samples, mask: present, ...expected }, message) {
  same(found, expected, message);
  for (const [one, other] of [[data, samples], [mask, present]]) {
    assert.equal(one?.length, other?.length, message);
    if (one) assert.ok(Buffer.from(one.buffer, one.byteOffset, one.byteLength).equals(Buffer.from(other.buffer, other.byteOffset, other.byteLength)), message);
  }
}

/** All cells, without the histogram, which takes values. */
const whole = { bins: 0 };

/** Compares queries of an index with those of the ordinary tree. */
async function compare(found, kind, message) {
  const expected = await open(at(`${kind}.goblin`));
  assert.equal(found.header.codec, "reference", message);
  assert.equal(found.header.depth, expected.header.depth, message);
  for (let level = 0; level <= expected.header.depth; level += 1) {
    sameWindow(await found.window({ level }), await expected.window({ level }), `${message}: level ${level}`);
  }
  const part = { cells: [250, 130, 550, 387] };
  sameWindow(await found.window(part), await expected.window(part), message);
  same(await found.stats(), await expected.stats(), message);
  same(await found.histogram({ bins: 8 }), await expected.histogram({ bins: 8 }), message);
  const points = [[300015, 3199985], [310000, 3190000], [320984, 3184115]];
  same(await found.points(points), await expected.points(points), message);
  const ring = [[301000, 3199000], [318000, 3197000], [309000, 3185500], [301000, 3199000]];
  const geometry = { type: "Polygon", coordinates: [ring] };
  const zone = { geometry, crs: "world" };
  same(await found.stats(zone), await expected.stats(zone), message);
  expected.close();
}

test("indexes on a disk and on a server equal ordinary trees", async () => {
  const url = await serve();
  for (const kind of ["classes", "heights"]) {
    for (const compression of ["none", "lzw", "deflate", "zstd"]) {
      const name = `${kind}_${compression}.goblin`;
      const warnings = await warningsOf(async () => {
        for (const place of [at(name), url + name]) {
          const found = await open(place);
          await compare(found, kind, place);
          assert.deepEqual(found.warnings, []);
          found.close();
        }
      });
      assert.deepEqual(warnings, []);
    }
  }
});

test("cells take one batch more than an index alone, and statistics take no source", async () => {
  const state = {};
  const url = await serve(state);
  const found = await open(`${url}heights_lzw.goblin`);
  await found.stats(whole);
  assert.ok(state.requests.every(({ name }) => name.endsWith(".goblin")), "no source yet");
  let traffic = { batches: 0, bytes: 0 };
  await found.window({ cells: [10, 10, 30, 30], progress: (total) => { traffic = total; } });
  assert.ok(traffic.batches <= 2, `${traffic.batches} batches`);
  assert.ok(state.requests.some(({ name, range }) => name === "heights_lzw.tif" && range));
  found.close();
});

test("a source in several files, some of which are on another host", async () => {
  const state = {};
  const near = await serve(state);
  const far = await serve(state);
  const half = HEIGHT / 2;
  const part = (from, to) => classes.slice(from * WIDTH, to * WIDTH);
  writeTiff("north.tif", part(0, half), WIDTH, half, "deflate");
  writeTiff("all.tif", classes, WIDTH, HEIGHT, "lzw");
  await index(`${far}all.tif`, `${near}north.tif`, "-o", at("both.goblin"), "--kind", "categorical");
  state.requests.length = 0;
  const found = await open(`${near}both.goblin`, { headers: { Authorization: "secret" } });
  await compare(found, "classes", "both");
  const by = (wanted) => state.requests.filter(({ name }) => name === wanted);
  assert.ok(by("all.tif").length > 0 && by("north.tif").length > 0);
  assert.ok(by("all.tif").every(({ token }) => token === undefined), "the other host gets no token");
  assert.ok(by("north.tif").every(({ token }) => token === "secret"));
  found.close();
});

test("another entity tag or time is one warning", async () => {
  const state = {};
  const url = await serve(state);
  await index(`${url}classes_lzw.tif`, "-o", at("tagged.goblin"), "--kind", "categorical");
  state.etag = '"2"';
  const found = await open(`${url}tagged.goblin`);
  const warnings = await warningsOf(() => compare(found, "classes", "another tag"));
  assert.equal(warnings.length, 1);
  assert.match(warnings[0], /classes_lzw\.tif: has another length or entity tag/);
  assert.deepEqual(found.warnings, warnings);
  writeFileSync(at("copy.tif"), readFileSync(at("classes_lzw.tif")));
  spinney("index", "-q", at("copy.tif"), "-o", at("copy.goblin"), "--kind", "categorical");
  writeFileSync(at("copy.tif"), readFileSync(at("classes_lzw.tif")));
  const local = await open(at("copy.goblin"));
  assert.match((await warningsOf(() => compare(local, "classes", "another time"))).join(), /^\S+copy\.tif: has another length or modification time[^,]*$/);
});

test("a changed tile is an error of the queries that need it", async () => {
  const url = await serve();
  const starts = writeTiff("changed.tif", heights, WIDTH, HEIGHT, "deflate");
  spinney("index", "-q", at("changed.tif"), "-o", at("changed.goblin"), "--kind", "continuous");
  const bytes = readFileSync(at("changed.tif"));
  bytes[starts[0] + 100] ^= 1;
  writeFileSync(at("changed.tif"), bytes);
  const expected = await open(at("heights.goblin"));
  for (const place of [at("changed.goblin"), `${url}changed.goblin`]) {
    await warningsOf(async () => {
      const found = await open(place);
      await assert.rejects(found.window(), { code: "corrupt", file: /changed\.tif$/, message: /checksum .*spinney index --update/ });
      same(await found.stats(whole), await expected.stats(whole));
      const far = { cells: [520, 300, 620, 400] };
      sameWindow(await found.window(far), await expected.window(far));
    });
  }
});

test("a missing source, and one that was truncated", async () => {
  const url = await serve();
  for (const [change, pattern] of [
    [() => rmSync(at("gone.tif")), { code: "not-found", message: /gone\.tif/ }],
    [() => writeFileSync(at("gone.tif"), readFileSync(at("heights_none.tif")).subarray(0, 5000)), { code: "changed", message: /gone\.tif: .*update the index/ }],
  ]) {
    writeTiff("gone.tif", heights, WIDTH, HEIGHT, "none");
    spinney("index", "-q", at("gone.tif"), "-o", at("gone.goblin"), "--kind", "continuous");
    change();
    for (const place of [at("gone.goblin"), `${url}gone.goblin`]) {
      await warningsOf(async () => {
        const found = await open(place);
        await found.stats(whole);
        await assert.rejects(found.window(), pattern);
      });
    }
  }
});

test("compressions that the module cannot decode are named", async () => {
  const jpeg = readFileSync(join(root, "tests/import/images/rgb.jpg"));
  let place = 2;
  while (jpeg[place + 1] < 0xc0 || jpeg[place + 1] > 0xc2) place += 2 + jpeg.readUInt16BE(place + 2);
  const [height, width] = [jpeg.readUInt16BE(place + 5), jpeg.readUInt16BE(place + 7)];
  const sampling = jpeg[place + 11];
  writeChunks("jpeg.tif", { 256: [width], 257: [height], 258: [8, 8, 8], 259: [7], 262: [6], 277: [3], 278: [height], 530: [sampling >> 4, sampling & 15] }, [273, 279], [jpeg]);
  spinney("index", "-q", at("jpeg.tif"), "-o", at("jpeg.goblin"));
  const found = await open(at("jpeg.goblin"));
  await assert.rejects(found.window(), { file: /jpeg\.tif$/, code: "unsupported", message: /jpeg compression/ });
});

test("an index without a place names the source that it needs", async () => {
  const bytes = readFileSync(at("classes_lzw.goblin"));
  for (const source of [bytes, new Blob([bytes]), { name: "x", size: bytes.length, read: async (start, end) => new Uint8Array(bytes.subarray(start, end)) }]) {
    const found = await open(source);
    await found.stats();
    await assert.rejects(found.window(), { code: "unsupported", message: /its cells are in the file classes_lzw\.tif, which cannot be read from here; open the index by its URL/ });
  }
  // (URLs are read from anywhere.)
  const url = await serve();
  await index(`${url}classes_deflate.tif`, "-o", at("url.goblin"), "--kind", "categorical");
  await compare(await open(new Blob([readFileSync(at("url.goblin"))])), "classes", "URLs in a Blob");
});

test("a host that serves no ranges of sources", async () => {
  const url = await serve({ hasNoRanges: /\.tif$/ });
  const found = await open(`${url}classes_lzw.goblin`);
  await compare(found, "classes", "no ranges");
  assert.equal(found.warnings.length, 1);
  assert.match(found.warnings[0], /classes_lzw\.tif: the host does not serve ranges of it: all of its \d+ bytes were read/);
});

test("after a panic, in a worker, and with a small cache", async () => {
  const url = await serve();
  const found = await open(`${url}heights_zstd.goblin`, { cacheBytes: 1 });
  await found.window({ cells: [0, 0, 9, 9] });
  await assert.rejects(found.query("panic", {}), { name: "PanicError" });
  await compare(found, "heights", "after a panic");
  engine.setCacheBytes(2 ** 26);
  const worker = new Worker(new URL("../../crates/site/page/spinney/worker.js", import.meta.url));
  setWorker(() => worker);
  const remote = await openInWorker(`${url}classes_deflate.goblin`);
  await compare(remote, "classes", "in a worker");
  await worker.terminate();
});

test("the program serves sources of its directory's indexes, and only those", async () => {
  const { url, stop } = await serveByProgram(directory);
  try {
    await compare(await open(`${url}classes_lzw.goblin`), "classes", "served");
    assert.equal((await fetch(`${url}classes_lzw.tif`, { headers: { Range: "bytes=0-3" } })).status, 206);
    writeTiff("other.tif", classes, WIDTH, HEIGHT, "none");
    assert.equal((await fetch(`${url}other.tif`)).status, 404);
  } finally {
    stop();
  }
});
