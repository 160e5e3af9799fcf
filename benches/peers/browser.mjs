// Windows in the JavaScript package, compared with geotiff.js, both with the file in memory:
//
//     npm install geotiff        (NODE_PATH or the third argument gives its location)
//     `node benches/peers/browser.mjs TREE.goblin COG.tif [DIRECTORY/node_modules/geotiff]`
//
// 1,000 unaligned windows of 256 x 256 cells at random positions of random levels, the same for
// both; and the size of the module. The COG may be written by `spinney export TREE.goblin COG.tif
// --tile-size 256`. RECORD=1 records the figures, see common.py.

import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { fileURLToPath, pathToFileURL } from "node:url";
import { gzipSync } from "node:zlib";

import { open } from "../../crates/site/page/spinney/index.js";

const [tree, cog, peer] = process.argv.slice(2);
const SIDE = 256;
const COUNT = 1000;

const module = readFileSync(fileURLToPath(new URL("../../crates/site/page/spinney/module_bg.wasm", import.meta.url)));
const packed = gzipSync(module, { level: 9 }).length;
console.log(`module: ${module.length} bytes, gzip ${packed}`);
const rows = [{ job: "module by gzip", unit: "bytes", ours: packed }];

let state = 3;
const random = () => {
  state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
  return state / 2 ** 32;
};

const file = readFileSync(tree);
const map = await open(file);
const { size, depth } = map.header;
const windows = [];
while (windows.length < COUNT) {
  const up = Math.floor(random() * 6);
  const [width, height] = size.map((cells) => Math.floor(cells / 2 ** up));
  if (width <= SIDE || height <= SIDE) continue;
  windows.push({ up, x: Math.floor(random() * (width - SIDE)), y: Math.floor(random() * (height - SIDE)) });
}

async function time(name, work) {
  await work(windows.slice(0, 50));
  const start = performance.now();
  const sum = await work(windows);
  const seconds = (performance.now() - start) / 1000;
  console.log(`${name}: ${seconds.toFixed(3)} s (sum of samples ${sum})`);
  return seconds;
}

// A subset of the samples, to compare both: adding all takes longer than reading them.
const add = (sum, data) => {
  for (let at = 0; at < data.length; at += 97) sum += data[at];
  return sum;
};

const own = await time("spinney", async (list) => {
  let sum = 0;
  for (const { up, x, y } of list) {
    const { data } = await map.window({ level: depth - up, cells: [x, y, x + SIDE, y + SIDE].map((cell) => cell * 2 ** up) });
    sum = add(sum, data);
  }
  return sum;
});

if (cog) {
  const { fromArrayBuffer } = await import(peer ? pathToFileURL(`${peer}/dist-module/geotiff.js`).href : "geotiff");
  const bytes = readFileSync(cog);
  const tiff = await fromArrayBuffer(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
  const images = [];
  for (let number = 0; number < (await tiff.getImageCount()); number += 1) images.push(await tiff.getImage(number));
  const other = await time("geotiff.js", async (list) => {
    let sum = 0;
    for (const { up, x, y } of list) {
      const [data] = await images[up].readRasters({ window: [x, y, x + SIDE, y + SIDE] });
      sum = add(sum, data);
    }
    return sum;
  });
  console.log(`geotiff.js takes ${(other / own).toFixed(1)} times as long`);
  const job = `${COUNT.toLocaleString("en")} windows of ${SIDE} x ${SIDE}, ${tree.split("/").at(-1).split(/[._]/)[0]}, ${tree.includes("packed") ? "packed" : "plain"}`;
  rows.push({ job, unit: "s", ours: own, peer: "geotiff.js", peer_figure: other });
}
if (process.env.RECORD === "1") {
  const common = fileURLToPath(new URL("common.py", import.meta.url));
  execFileSync("python3", [common, "JavaScript package", ...process.argv.slice(1)], { input: JSON.stringify(rows) });
}
