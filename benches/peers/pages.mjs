// Pages in headless Chromium, from a static host with 50 ms of latency and 10 MB/s, compared with
// OpenLayers with geotiff.js:
//
//     npm install playwright-core ol geotiff esbuild       (in a DIRECTORY)
//     [ZONES=FILE.geojson] node benches/peers/pages.mjs TREE.goblin COG.tif DIRECTORY [STYLE]
//
// Chromium is /usr/bin/chromium, or CHROMIUM. RECORD=1 records the figures, see common.py.
//
// The first map: requests, bytes and seconds until the initial view is drawn. For the tree, also
// the class areas of a polygon with 400 vertices, or of each zone of a file (countries, written by
// remote.py), with empty caches: seconds from an empty page on, batches, requests and bytes of the
// file, and the deviation of cell counts from the program's.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { copyFileSync, mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { fileURLToPath } from "node:url";

import { serve } from "../../crates/site/test/server.mjs";

const [tree, cog, peers, style] = process.argv.slice(2);
const need = createRequire(join(peers, "/"));
const { chromium } = need("playwright-core");
const root = fileURLToPath(new URL("../..", import.meta.url));
const program = process.env.SPINNEY ?? join(root, "target/release/spinney");
const spinney = (...list) => execFileSync(program, list, { encoding: "utf8" });
const directory = mkdtempSync(join(tmpdir(), "spinney-pages-"));
const HOST = { delay: 50, bytesPerSecond: 10_000_000, packs: true };

spinney("export", "-q", tree, join(directory, "own/index.html"), ...(style ? ["--style", style] : []));
mkdirSync(join(directory, "peer"));
copyFileSync(cog, join(directory, "peer/map.tif"));
writeFileSync(join(directory, "peer.js"), `
  import Map from "ol/Map.js";
  import View from "ol/View.js";
  import TileLayer from "ol/layer/WebGLTile.js";
  import GeoTIFF from "ol/source/GeoTIFF.js";
  const source = new GeoTIFF({ sources: [{ url: "map.tif" }] });
  const map = new Map({ target: "map", layers: [new TileLayer({ source })], view: source.getView() });
  map.on("rendercomplete", () => document.documentElement.setAttribute("data-drawn", ""));
`);
execFileSync(join(peers, "node_modules/.bin/esbuild"), [join(directory, "peer.js"), "--bundle", "--minify", "--format=esm", `--outfile=${join(directory, "peer/peer.js")}`, "--log-level=error"], { env: { ...process.env, NODE_PATH: join(peers, "node_modules") } });
writeFileSync(join(directory, "peer/index.html"), '<!doctype html><div id="map" style="width: 1200px; height: 800px"></div><script type="module" src="peer.js"></script>');

const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  args: ["--no-sandbox", "--disable-background-networking", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
});

async function visit(name, address, work) {
  const host = await serve(join(directory, name), HOST);
  const context = await browser.newContext({ viewport: { width: 1200, height: 800 } });
  const page = await context.newPage();
  page.on("pageerror", (error) => console.log(`${name}: ${error}`));
  const start = performance.now();
  await page.goto(host.url + address);
  const found = await work(page);
  const seconds = (performance.now() - start) / 1000;
  await context.close();
  await host.close();
  return { ...found, seconds, requests: host.requests };
}

const sum = (requests) => requests.reduce((bytes, one) => bytes + one.sent, 0);
function report(name, { seconds, requests }, data) {
  const [of, code] = [requests.filter(({ path }) => path.endsWith(data)), requests.filter(({ path }) => !path.endsWith(data))];
  console.log(`${name}: ${seconds.toFixed(2)} s; of the file ${of.length} requests, ${sum(of)} bytes; of the page ${code.length} requests, ${sum(code)} bytes`);
  return { of: sum(of), requests: of.length, code: sum(code), all: sum(requests), seconds };
}

const own = report("first map, the page", await visit("own", "index.html", (page) => page.waitForSelector("html[data-drawn]", { timeout: 60_000 }).then(() => ({}))), ".goblin");
const peer = report("first map, OpenLayers and geotiff.js", await visit("peer", "index.html", (page) => page.waitForSelector("html[data-drawn]", { timeout: 60_000 }).then(() => ({}))), ".tif");
console.log(`of the file ${(own.of / peer.of).toFixed(2)} of the bytes, ${(own.requests / peer.requests).toFixed(2)} of the requests; with the code ${(own.all / peer.all).toFixed(2)} of the bytes`);

// A star around the centre of Europe.
const ring = Array.from({ length: 400 }, (_, at) => {
  const [angle, radius] = [(2 * Math.PI * at) / 400, at % 2 ? 5 : 6];
  return [10 + radius * Math.cos(angle), 50 + radius * Math.sin(angle)];
});
const star = { type: "Feature", properties: { name: "a star" }, geometry: { type: "Polygon", coordinates: [[...ring, ring[0]]] } };
const zones = process.env.ZONES ? JSON.parse(readFileSync(process.env.ZONES, "utf8")).features : [star];
writeFileSync(join(directory, "own/empty.html"), "<!doctype html><title>empty</title>");
const name = tree.split("/").at(-1);
const found = [];
for (const zone of zones) {
  const areas = await visit("own", "empty.html", (page) =>
    page.evaluate(async ([name, zone]) => {
      const start = performance.now();
      const { openInWorker } = await import("./assets/spinney/index.js");
      let batches = 0;
      const progress = (total) => (batches = total.batches);
      const map = await openInWorker(new URL(name, document.baseURI), { progress });
      const opening = batches;
      const opened = (performance.now() - start) / 1000;
      const { zones } = await map.zonal(zone, { progress });
      return { batches: opening + batches, opened, seconds: (performance.now() - start) / 1000, zone: zones[0] };
    }, [name, zone]).then(({ seconds, ...found }) => ({ ...found, inPage: seconds })),
  );
  const of = areas.requests.filter(({ path }) => path.endsWith(".goblin"));
  writeFileSync(join(directory, "zone.geojson"), JSON.stringify(zone));
  const [expected] = JSON.parse(spinney("stats", tree, "--zones", join(directory, "zone.geojson"), "--edge", "area", "--json")).zones;
  let [off, differ] = [0, 0];
  assert.equal(areas.zone.classes.length, expected.classes.length);
  for (const [index, one] of areas.zone.classes.entries()) {
    assert.equal(one.value, expected.classes[index].value);
    differ = Math.max(differ, Math.abs(one.cells - expected.classes[index].cells));
    off = differ / expected.cells;
  }
  found.push({ name: zone.properties.name, seconds: areas.inPage, query: areas.inPage - areas.opened, batches: areas.batches, requests: of.length, bytes: sum(of), off, differ });
}
const spread = (key) => {
  const sorted = found.map((one) => one[key]).sort((a, b) => a - b);
  const [median, most] = [sorted[Math.floor(sorted.length / 2)], sorted.at(-1)].map((number) => (Number.isInteger(number) ? number : Number(number.toPrecision(3))));
  return found.length === 1 ? `${median}` : `${median} in the median, ${most} at most (${found.find((one) => one[key] === sorted.at(-1)).name})`;
};
console.log(`class areas of ${found.length === 1 ? found[0].name : `${found.length} zones`}, cold: seconds with loading the package ${spread("seconds")}; of the query alone ${spread("query")}`);
console.log(`batches, besides the one that opens, ${spread("batches")}; requests ${spread("requests")}; bytes of the file ${spread("bytes")}; off from the program's by ${spread("off")} of the cells`);
if (process.env.RECORD === "1") {
  const rows = [["", "s", "seconds", 1], [": requests for the file", "requests", "requests", 1], [": bytes of the file", "kB", "of", 1000], [": code", "kB", "code", 1000]].map(
    ([end, unit, key, by]) => ({ job: `first map in Chromium${end}`, unit, ours: own[key] / by, peer: "OpenLayers with geotiff.js", peer_figure: peer[key] / by }),
  );
  const add = (job, unit, ours) => rows.push({ job, unit, ours });
  const sorted = (key) => found.map((one) => one[key]).sort((a, b) => a - b);
  if (found.length === 1) {
    const job = "class areas of a polygon of 400 vertices, cold, Chromium";
    add(job, "s", found[0].seconds);
    add(`${job}: bytes`, "kB", found[0].bytes / 1000);
  } else {
    const job = `class areas of ${found.length} countries, Chromium`;
    for (const [name, unit, key] of [[", from an empty page: ", "s", "seconds"], [", query alone: ", "s", "query"], [": bytes, ", "bytes", "bytes"]]) {
      add(`${job}${name}median`, unit, sorted(key)[Math.floor(found.length / 2)]);
      add(`${job}${name}maximum`, unit, sorted(key).at(-1));
    }
    add(`${job}: batches`, "batches", sorted("batches")[Math.floor(found.length / 2)]);
    add(`${job}: cells that differ from the program's`, "cells", sorted("differ").at(-1));
  }
  const common = fileURLToPath(new URL("common.py", import.meta.url));
  execFileSync("python3", [common, "JavaScript package", ...process.argv.slice(1)], { input: JSON.stringify(rows) });
}
await browser.close();
rmSync(directory, { recursive: true });
