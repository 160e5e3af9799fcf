// Headers, windows, points, statistics and searches of every file, against the program's.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { basename, join } from "node:path";
import test from "node:test";

import { open } from "../../crates/site/page/spinney/index.js";
import { bytesOf, files, layersOf, near, random, root, same, spinney, spinneyJson, spinneyJsonLines, temporaryDirectory } from "./helpers.mjs";

const { cells } = files();
const work = temporaryDirectory();
const districts = join(root, "fixtures/island_districts.geojson");

/** Visits each layer of each file, with the program's name for it. */
async function eachLayer(visit) {
  for (const path of cells) {
    const first = await open(path);
    for (const layer of layersOf(first.header)) {
      const dataset = first.header.layers.length > 1 ? await first.openLayer(layer) : first;
      await visit(dataset, first.header.layers.length > 1 ? `${path}:${layer}` : path);
      if (dataset !== first) dataset.close();
    }
    first.close();
  }
}

test("headers have what the program's `info` prints", async () => {
  await eachLayer(async ({ header }, path) => {
    const info = spinneyJson("info", "--json", path);
    const expected = { size: info.size, depth: info.depth, kind: info.kind, rule: info.rule, layer: info.layer, tags: info.tags };
    same({ size: header.size, depth: header.depth, kind: header.meaning, rule: header.rule, layer: header.layer, tags: header.tags }, expected, path);
    same(header.crs?.epsg ?? null, info.epsg, path);
    same(header.unit, info.unit, path);
    same(header.bounds, info.world.flat(), path);
    same(header.matrix, info.matrix, path);
    same(header.noData, info.nodata, path);
    same(header.bytes, info.bytes, path);
    same(header.commit, info.commit, path);
    assert.equal(header.format, info.format.toLowerCase());
    assert.equal(header.codec, info.codec);
    assert.equal(header.kind, info.tree === "octree" ? "volume" : "raster");
  });
});

/**
 * The first of several numbers that the program writes for VOID, since no value of the layer equals
 * it; `undefined` if there is none.
 */
function freeNumber(header, path) {
  const candidates = [header.noData, 0, 255, 65535, -1, -32768].filter((number) => number != null);
  return candidates.find((number) => {
    try {
      spinney("get", "-q", path, join(work, "free.raw"), "--level", 0, `--nodata=${number}`);
      return true;
    } catch (error) {
      assert.match(String(error.stderr), /nodata/, path);
      return false;
    }
  });
}

test("windows of all levels have the program's samples", async () => {
  const next = random(7);
  await eachLayer(async (dataset, path) => {
    const { header } = dataset;
    const free = freeNumber(header, path);
    const nodata = free === undefined ? [] : [`--nodata=${free}`];
    const fill = free ?? 0;
    for (let level = header.depth; level >= 0; level -= level > 4 ? 2 : 1) {
      const part = header.size.map((size) => {
        const first = Math.floor(next() * size);
        return [first, first + 1 + Math.floor(next() * (size - first))];
      });
      const request = { cells: [...part.map(([first]) => first), ...part.map(([, end]) => end)] };
      const found = await dataset.window({ ...request, level });
      const raw = join(work, "window.raw");
      const window = [...part.map(([first]) => first), ...part.map(([first, end]) => end - first)].join(",");
      spinney("get", "-q", path, raw, "--level", level, "--window", window, ...nodata);
      const again = await dataset.window({ ...request, level, fill });
      const bytes = new Uint8Array(again.data.buffer);
      assert.deepEqual(Buffer.from(bytes).compare(Buffer.from(bytesOf(raw))), 0, `${path}, level ${level}, window ${window}`);
      assert.equal(found.data.length, found.width * found.height * found.layers * found.channels);
      assert.equal(found.level, level);
      if (found.mask) assert.equal(found.mask.length, found.width * found.height * found.layers);
    }
  });
});

test("points are those of the program", async () => {
  const next = random(11);
  await eachLayer(async (dataset, path) => {
    const { header } = dataset;
    const axes = header.dimension;
    const positions = Array.from({ length: 40 }, () =>
      Array.from({ length: axes }, (_, axis) => {
        const [low, high] = [header.bounds[axis], header.bounds[axes + axis]];
        return low + (next() * 1.1 - 0.05) * (high - low);
      }),
    );
    const expected = spinneyJsonLines("point", "--json", path, "--", ...positions.map((position) => position.join(",")));
    const found = await dataset.points(positions);
    found.forEach((point, index) => {
      const { outside, layers } = expected[index];
      assert.equal(point.isOutside, outside, `${path}: ${positions[index]}`);
      same(point.values, layers[0].samples, `${path}: ${positions[index]}`);
    });
    same(await dataset.point(positions[3]), found[3]);
    if (header.sampleType === "u64" || header.sampleType === "i64") {
      assert.ok(found.some((point) => typeof point.value === "bigint"), path);
    }
  });
});

test("statistics are those of the program", async () => {
  const next = random(13);
  await eachLayer(async (dataset, path) => {
    const { header } = dataset;
    const { solid, ...all } = spinneyJson("stats", "--json", path);
    same(await dataset.stats(), all, path);
    const part = header.size.map((size) => {
      const first = Math.floor(next() * size);
      return [first, first + 1 + Math.floor(next() * (size - first))];
    });
    const window = [...part.map(([first]) => first), ...part.map(([first, end]) => end - first)].join(",");
    const request = { cells: [...part.map(([first]) => first), ...part.map(([, end]) => end)] };
    same(await dataset.stats(request), spinneyJson("stats", "--json", path, "--window", window), path);
    if (header.dimension === 2 && header.crs) {
      const [west, south, east, north] = header.bounds;
      const bounds = [west + (east - west) * 0.21, south + (north - south) * 0.33, west + (east - west) * 0.77, south + (north - south) * 0.61];
      same(await dataset.stats({ bounds }), spinneyJson("stats", "--json", path, "--in", "world", "--window", bounds.join(",")), path);
      const histogram = await dataset.histogram({ bins: 16 });
      const whole = await dataset.stats({ bins: 16 });
      if (whole.classes.length === 0) same(histogram.bins, whole.histogram, path);
    }
  });
});

test("statistics of polygons are those of the program", async () => {
  const zones = JSON.parse(readFileSync(districts, "utf8"));
  let count = 0;
  await eachLayer(async (dataset, path) => {
    const { crs, dimension } = dataset.header;
    if (crs?.epsg !== 32628 || dimension !== 2) return;
    count += 1;
    // (Squares of 64-bit integers do not fit into doubles.)
    const loose = ["u64", "i64"].includes(dataset.header.sampleType) ? ["standard_deviation"] : [];
    for (const edge of ["area", "centre", "touch"]) {
      const list = ["stats", "--json", path, "--zones", districts, "--edge", edge];
      near(await dataset.zonal(zones, { edge }), spinneyJson(...list), `${path}, ${edge}`, loose);
    }
    const more = { measures: ["majority", "median"], quantiles: [0.1, 0.9] };
    const list = ["stats", "--json", path, "--zones", districts, "--edge", "area", "--measure", "majority,median", "--quantiles", "0.1,0.9"];
    near(await dataset.zonal(zones, more), spinneyJson(...list), path, loose);
    const [first] = (await dataset.zonal(zones)).zones;
    const { id, ...alone } = await dataset.stats({ geometry: zones.features[0].geometry, crs: "EPSG:32628" });
    assert.equal(alone.cells, first.cells);
  });
  assert.ok(count >= 4, "files are queried");
  const stack = await open(join(root, "fixtures/v1/stack.goblin"));
  const list = ["stats", "--json", join(root, "fixtures/v1/stack.goblin"), "--zones", districts, "--edge", "area"];
  near(await stack.zonal(zones, { layers: layersOf(stack.header) }), spinneyJson(...list), "stack", ["standard_deviation"]);
});

test("searches find the program's blocks", async () => {
  await eachLayer(async (dataset, path) => {
    const { channels, classes } = await dataset.stats();
    if (channels.length === 0) return;
    const middle = channels[0].mean;
    const above = await dataset.find({ where: { above: middle }, limit: 1e6 });
    same(above.blocks, spinneyJsonLines("find", "--json", path, "--above", middle), path);
    assert.ok(above.isAll);
    if (classes.length > 0) {
      const { value } = classes.at(-1);
      const found = await dataset.find({ where: { equal: value }, largest: 3 });
      same(found.blocks, spinneyJsonLines("find", "--json", path, "--class", value, "--largest", 3), path);
      const one = await dataset.find({ where: { equal: value }, limit: 1 });
      same(one.blocks, spinneyJsonLines("find", "--json", path, "--class", value, "--limit", 1), path);
    }
  });
});

test("coordinates of other systems are transformed to the file's", async () => {
  const path = join(root, "fixtures/v1/classes.goblin");
  const map = await open(path);
  const [west, south, east, north] = map.header.geographicBounds;
  const position = [(west + east) / 2, (south + north) / 2];
  const [line] = spinneyJsonLines("point", "--json", path, "--in", "lonlat", "--", position.join(","));
  same((await map.point(position, { crs: "lonlat" })).values, line.layers[0].samples);
  same((await map.point(position, { crs: "EPSG:4326" })).values, line.layers[0].samples);
  const [x, y, right, top] = map.header.bounds;
  const corners = await map.geographic([[x, y], [right, top], [x, top], [right, y]]);
  for (const [lon, lat] of corners) assert.ok(lon >= west - 1e-9 && lon <= east + 1e-9 && lat >= south - 1e-9 && lat <= north + 1e-9);
  assert.equal(corners.length, 4);
  const bounds = [west + 0.02, south + 0.02, east - 0.02, north - 0.02];
  same(await map.stats({ bounds, crs: "lonlat" }), spinneyJson("stats", "--json", path, "--in", "lonlat", "--window", bounds.join(",")));
});

test("invalid requests are errors with a code", async () => {
  const map = await open(join(root, "fixtures/v1/classes.goblin"));
  const fails = async (promise, code, pattern) => {
    await assert.rejects(promise, (error) => {
      assert.equal(error.name, "SpinneyError");
      assert.equal(error.code, code, error.message);
      assert.match(error.message, pattern);
      return true;
    });
  };
  await fails(map.window({ level: 99 }), "invalid", /level/);
  await fails(map.window({ cells: [0, 0, -1, 3] }), "invalid", /cells/);
  await fails(map.window({ cells: [0, 0, 2 ** 31, 2 ** 31] }), "too-large", /smaller region/);
  await fails(map.window({ level: 3, size: 3 }), "invalid", /one of the two/);
  await fails(map.window({ channels: [1] }), "invalid", /channel/);
  await fails(map.stats({ bounds: [0, 0, 1, 1] }), "invalid", /bounds/);
  await fails(map.point([1, 2], { crs: "EPSG:999999" }), "invalid", /EPSG/);
  await fails(map.zonal({ type: "Point", coordinates: [1, 2] }), "invalid", /Point/);
  await fails(map.zonal("{"), "invalid", /GeoJSON/i);
  await fails(map.find({}), "invalid", /above, below or equal/);
  await fails(map.slice({ axis: "z", index: 0 }), "unsupported", /octree/);
  await fails(map.commits(), "unsupported", /without commits/);
  await fails(map.openLayer("nothing"), "invalid", /layer/);
  await fails(open(join(root, "fixtures/v1/classes.goblin"), { layer: "nothing" }), "invalid", /layer/);
  await fails(open(join(root, "README.md")), "corrupt", /signature of a tree/);
  await fails(open(join(root, "fixtures/island_classes.tif")), "no-tree", /TIFF/i);
  await fails(open(join(root, "nowhere.goblin")), "io", /cannot open/);
  await assert.rejects(open(12), TypeError);
  map.close();
  await fails(map.stats(), "invalid", /closed/);
});

test("sizes select levels, and channels are selected", async () => {
  const map = await open(join(root, "fixtures/v1/classes.goblin"));
  const { width, level } = await map.window({ size: 60 });
  assert.deepEqual([width, level], [64, 6]);
  assert.equal((await map.window({ size: 1e6 })).level, 8);
  const image = await open(join(root, "fixtures/v1/rgba.goblin"));
  const all = await image.window();
  const some = await image.window({ channels: [2, 0] });
  for (let at = 0; at < all.width * all.height; at += 1) {
    assert.equal(some.data[2 * at], all.data[4 * at + 2]);
    assert.equal(some.data[2 * at + 1], all.data[4 * at]);
  }
});
