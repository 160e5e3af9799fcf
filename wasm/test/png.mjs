// Reader of the program's PNG images.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { inflateSync } from "node:zlib";

/**
 * Red, green, blue and opacity of a PNG, from a path or bytes, with eight bits per sample (one to
 * eight with palettes), without interlacing.
 */
export function readPng(source) {
  const file = typeof source === "string" ? readFileSync(source) : Buffer.from(source);
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

/** Asserts that images are visually equal: transparent pixels do not count. */
export function alike(found, expected, message) {
  assert.deepEqual([found.width, found.height], [expected.width, expected.height], message);
  for (let at = 0; at < expected.rgba.length; at += 4) {
    if (expected.rgba[at + 3] === 0 && found.data[at + 3] === 0) continue;
    const [a, b] = [found.data, expected.rgba].map((data) => [...data.subarray(at, at + 4)].join());
    if (a !== b) assert.fail(`${message}: pixel ${at / 4} is ${a}, not ${b}`);
  }
}
