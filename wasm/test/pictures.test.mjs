// Pictures, tiles and legends, against the program's.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { basename, join } from "node:path";
import test from "node:test";
import { inflateSync } from "node:zlib";

import { open } from "../dist/index.js";
import { files, folder, spinney } from "./helpers.mjs";

const { cells, made } = files();
const work = folder();

/** Red, green, blue and opacity of a PNG of eight bits a sample (and of palettes of one to eight), without interlacing. */
function readPng(path) {
  const file = readFileSync(path);
  let [at, width, height, bits, kind] = [8];
  const data = [];
  let [palette, alpha] = [];
  while (at < file.length) {
    const length = file.readUInt32BE(at);
    const name = file.toString("latin1", at + 4, at + 8);
    const body = file.subarray(at + 8, at + 8 + length);
    if (name === "IHDR") [width, height, bits, kind] = [body.readUInt32BE(0), body.readUInt32BE(4), body[8], body[9]];
    if (name === "PLTE") palette = body;
    if (name === "tRNS") alpha = body;
    if (name === "IDAT") data.push(body);
    at += 12 + length;
  }
  const samples = { 0: 1, 2: 3, 3: 1, 4: 2, 6: 4 }[kind];
  const row = Math.ceil((width * samples * bits) / 8);
  const step = Math.max(1, (samples * bits) / 8);
  const raw = inflateSync(Buffer.concat(data));
  const lines = Buffer.alloc(height * row);
  for (let y = 0; y < height; y += 1) {
    const filter = raw[y * (row + 1)];
    for (let x = 0; x < row; x += 1) {
      const left = x >= step ? lines[y * row + x - step] : 0;
      const above = y > 0 ? lines[(y - 1) * row + x] : 0;
      const corner = x >= step && y > 0 ? lines[(y - 1) * row + x - step] : 0;
      const guess = left + above - corner;
      const near = [left, above, corner].reduce((best, each) => (Math.abs(guess - each) < Math.abs(guess - best) ? each : best));
      lines[y * row + x] = raw[y * (row + 1) + 1 + x] + [0, left, above, (left + above) >> 1, near][filter];
    }
  }
  const rgba = new Uint8ClampedArray(width * height * 4);
  for (let pixel = 0; pixel < width * height; pixel += 1) {
    const [x, y] = [pixel % width, Math.floor(pixel / width)];
    const sample = (channel) => lines[y * row + x * samples + channel];
    const bit = x * bits;
    const small = (lines[y * row + (bit >> 3)] >> (8 - bits - (bit & 7))) & ((1 << bits) - 1);
    const colour = {
      0: () => { const grey = Math.round((small * 255) / ((1 << bits) - 1)); return [grey, grey, grey, alpha && alpha[1] === small ? 0 : 255]; },
      2: () => [sample(0), sample(1), sample(2), 255],
      3: () => [...palette.subarray(3 * small, 3 * small + 3), alpha?.[small] ?? 255],
      4: () => [sample(0), sample(0), sample(0), sample(1)],
      6: () => [sample(0), sample(1), sample(2), sample(3)],
    }[kind]();
    rgba.set(colour, 4 * pixel);
  }
  return { width, height, rgba };
}

/** Whether pictures are alike: what nobody sees does not count. */
function alike(found, expected, message) {
  assert.deepEqual([found.width, found.height], [expected.width, expected.height], message);
  for (let at = 0; at < expected.rgba.length; at += 4) {
    if (expected.rgba[at + 3] === 0 && found.data[at + 3] === 0) continue;
    const [a, b] = [found.data, expected.rgba].map((data) => [...data.subarray(at, at + 4)].join());
    if (a !== b) assert.fail(`${message}: pixel ${at / 4} is ${a}, not ${b}`);
  }
}

for (const path of cells) {
  test(`pictures of ${basename(path)}`, async () => {
    const map = await open(path);
    const { header } = map;
    if (header.dimension !== 2 || header.layers.length > 1) return;
    const styles = header.channels === 1 ? ["viridis", "hillshade", undefined] : [undefined];
    const half = header.size.map((size) => Math.max(1, Math.floor(size / 2)));
    for (const style of styles) {
      for (const level of [header.depth, header.depth - 1]) {
        for (const cells of [undefined, [Math.floor(half[0] / 2), 0, half[0] + 1, half[1]]]) {
          const png = join(work, "picture.png");
          const window = cells && [cells[0], cells[1], cells[2] - cells[0], cells[3] - cells[1]].join(",");
          // (Without a style the program writes the values themselves, where these fit.)
          const name = style ?? (header.sampleType === "u8" ? undefined : "default");
          if (name === undefined) continue;
          spinney("get", "-q", path, png, "--level", level, "--style", name, ...(window ? ["--window", window] : []));
          alike(await map.image({ level, cells, style: name }), readPng(png), `${name}, level ${level}, ${window}`);
        }
      }
    }
    const { sections } = await map.legend();
    assert.ok(sections.length > 0);
    await assert.rejects(map.image({ style: "no such style" }), { code: "invalid" });
    map.close();
  });
}

test("tiles are those that the program exports", async () => {
  for (const name of ["island_classes_packed.goblin", "island_elevation.goblin"]) {
    const path = join(made, name);
    const map = await open(path);
    const tiles = join(work, `tiles_${name}`);
    const style = name.includes("classes") ? undefined : "terrain";
    spinney("export", "-q", path, join(tiles, "{z}/{x}/{y}.png"), "--zoom", "10..13", ...(style ? ["--style", style] : []));
    let count = 0;
    for (let z = 10; z <= 13; z += 1) {
      const side = 2 ** z;
      const [west, south, east, north] = map.header.geographicBounds;
      const column = (lon) => Math.floor(((lon + 180) / 360) * side);
      const row = (lat) => Math.floor(((1 - Math.asinh(Math.tan((lat * Math.PI) / 180)) / Math.PI) / 2) * side);
      for (let x = column(west); x <= column(east); x += 1) {
        for (let y = row(north); y <= row(south); y += 1) {
          const tile = await map.tile({ z, x, y, style });
          const file = join(tiles, `${z}/${x}/${y}.png`);
          let expected;
          try {
            expected = readPng(file);
          } catch {
            assert.equal(tile, null, file);
            continue;
          }
          count += 1;
          alike(tile, expected, file);
        }
      }
    }
    assert.ok(count > 3);
    assert.equal(await map.tile({ z: 5, x: 0, y: 0 }), null);
    await assert.rejects(map.tile({ z: 3, x: 8, y: 0 }), { code: "invalid" });
    const native = await map.tile({ z: 0, x: 0, y: 0, grid: "native", style });
    assert.equal(native.width, 256);
  }
});
