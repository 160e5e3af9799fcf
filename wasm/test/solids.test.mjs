// Octrees and exact models, against the program.

import assert from "node:assert/strict";
import { readFileSync, writeFileSync } from "node:fs";
import { basename, join } from "node:path";
import test from "node:test";

import { open } from "../../crates/site/page/spinney/index.js";
import { bytesOf, files, random, same, spinney, spinneyJson, temporaryDirectory } from "./helpers.mjs";
import { alike, readPng } from "./png.mjs";

const { cells, models } = files();
const work = temporaryDirectory();

/** Vertices and triangles of an OBJ. */
function readObj(path) {
  const lines = readFileSync(path, "utf8").split("\n");
  const numbers = (letter) => lines.filter((line) => line.startsWith(`${letter} `)).map((line) => line.slice(2).trim().split(/\s+/).map((word) => Number(word.split("/")[0])));
  return { vertices: numbers("v"), faces: numbers("f").map((face) => face.map((corner) => corner - 1)) };
}

/** Six times the volume that triangles enclose. */
function volumeOf(corner, triangles) {
  let sum = 0;
  for (const [a, b, c] of triangles) {
    const [[x, y, z], [u, v, w], [r, s, t]] = [corner(a), corner(b), corner(c)];
    sum += x * (v * t - w * s) - y * (u * t - w * r) + z * (u * s - v * r);
  }
  return sum / 6;
}

const trianglesOf = ({ indices }) => Array.from({ length: indices.length / 3 }, (_, at) => [...indices.subarray(3 * at, 3 * at + 3)]);

for (const path of cells) {
  test(`octrees: ${basename(path)}`, async () => {
    const solid = await open(path);
    const { header } = solid;
    if (header.dimension !== 3) return;
    const raw = join(work, "slice.raw");
    for (const [axis, name] of ["x", "y", "z"].entries()) {
      for (const level of [header.depth, header.depth - 2]) {
        const index = Math.floor(header.size[axis] / 3);
        const found = await solid.slice({ axis: name, index, level });
        spinney("get", "-q", path, raw, "--slice", `${name}=${index}`, "--level", level);
        assert.equal(Buffer.from(found.data.buffer).compare(Buffer.from(bytesOf(raw))), 0, `${name}=${index}, level ${level}`);
        assert.equal(found.data.length, found.width * found.height * found.channels);
        const png = join(work, "slice.png");
        spinney("get", "-q", path, png, "--slice", `${name}=${index}`, "--level", level, "--style", "viridis");
        alike(await solid.slice({ axis: name, index, level, style: "viridis" }), readPng(png), `${name}=${index}, level ${level}`);
      }
    }
    const [low, high] = [header.bounds.slice(0, 3), header.bounds.slice(3)];
    same((await solid.slice({ axis: "z", at: (low[2] + high[2]) / 2 })).data, (await solid.slice({ axis: "z", index: Math.floor(header.size[2] / 2) })).data);
    await assert.rejects(solid.slice({ axis: "z", at: high[2] + 1 }), { code: "invalid" });
    await assert.rejects(solid.slice({ axis: "z", index: 1e6 }), { code: "invalid" });
    for (const smooth of [false, true]) {
      for (const level of [header.depth, header.depth - 1]) {
        const obj = join(work, "mesh.obj");
        spinney("export", "-q", path, obj, "--triangles", "--level", level, ...(smooth ? ["--smooth"] : []));
        const expected = readObj(obj);
        const mesh = await solid.mesh({ level, smooth });
        assert.equal(mesh.positions.length / 3, expected.vertices.length);
        assert.equal(mesh.indices.length / 3, expected.faces.length);
        const at = (corner) => [0, 1, 2].map((axis) => mesh.positions[3 * corner + axis] + mesh.origin[axis]);
        const volumes = [volumeOf(at, trianglesOf(mesh)), volumeOf((corner) => expected.vertices[corner], expected.faces)];
        assert.ok(Math.abs(volumes[0] - volumes[1]) <= 1e-5 * Math.abs(volumes[1]), `${volumes}`);
      }
    }
    // The volumes of regions add up to the whole.
    const half = Math.floor(header.size[0] / 2);
    const [width, height, depth] = header.size;
    const volume = async (cells) => {
      const mesh = await solid.mesh({ cells });
      return volumeOf((corner) => [0, 1, 2].map((axis) => mesh.positions[3 * corner + axis] + mesh.origin[axis]), trianglesOf(mesh));
    };
    const whole = await volume([0, 0, 0, width, height, depth]);
    const sum = (await volume([0, 0, 0, half, height, depth])) + (await volume([half, 0, 0, width, height, depth]));
    assert.ok(Math.abs(whole - sum) <= 1e-5 * Math.abs(whole), `${whole}, ${sum}`);
    const next = random(3);
    for (let time = 0; time < 20; time += 1) {
      const point = low.map((from, axis) => from + next() * (high[axis] - from));
      const { value } = await solid.point(point);
      assert.equal(await solid.contains(point), header.rule === "occupancy" ? (value ?? 0) >= 128 : value !== null);
    }
  });
}

for (const path of models) {
  test(`exact models: ${basename(path)}`, async () => {
    const model = await open(path);
    const { header } = model;
    assert.equal(header.kind, "model");
    const info = spinneyJson("info", "--json", path);
    same([header.faces, header.objects, header.codec, header.depth], [info.faces, info.parts, info.codec, info.depth]);
    const expected = spinneyJson("stats", "--json", path);
    const measures = await model.measures();
    for (const name of ["volume", "surface", "centre", "second_moments", "inertia", "bounds", "unit"]) same(measures[name], expected[name], name);
    same(header.bounds, expected.bounds.flat());
    const [low, high] = expected.bounds;
    const next = random(5);
    const points = Array.from({ length: 50 }, () => low.map((from, axis) => from + (next() * 1.1 - 0.05) * (high[axis] - from)));
    const locations = spinney("point", path, "--", ...points.map((point) => point.join(","))).trim().split("\n");
    for (const [index, point] of points.entries()) {
      assert.equal(await model.locate(point), locations[index]);
      assert.equal(await model.contains(point), locations[index] !== "outside");
    }
    for (const [axis, name] of ["x", "y", "z"].entries()) {
      const at = low[axis] + 0.37 * (high[axis] - low[axis]);
      const file = join(work, "section.geojson");
      spinney("section", "-q", path, `${name}=${at}`, "-o", file);
      const { features } = JSON.parse(readFileSync(file, "utf8"));
      const section = await model.section({ axis: name, at });
      const areas = (list) => list.map(({ properties }) => properties.area).sort((a, b) => a - b);
      assert.deepEqual(areas(section.features), areas(features));
      for (const { geometry } of section.features) for (const ring of geometry.coordinates) assert.deepEqual(ring[0], ring.at(-1));
    }
    const { positions, objects, names, origin, triangles } = await model.triangles();
    assert.equal(positions.length, 9 * triangles);
    assert.equal(objects.length, triangles);
    assert.ok(objects.every((object) => object < names.length || names.length === 0));
    const at = (corner) => [0, 1, 2].map((axis) => positions[3 * corner + axis]);
    const volume = volumeOf(at, Array.from({ length: triangles }, (_, number) => [3 * number, 3 * number + 1, 3 * number + 2]));
    // (Proxies replace faces with off-grid vertices.)
    const tolerance = info.exact_faces > 0 ? 1e-2 : 1e-5;
    assert.ok(Math.abs(volume - expected.volume) <= tolerance * expected.volume, `${volume}, ${expected.volume}; ${origin}`);
    await assert.rejects(model.query("window", {}), { code: "unsupported", message: /exact model/ });
    await assert.rejects(model.section({ at: 3 }), { code: "invalid" });
  });
}

/** An OFF file of a torus of 5120 triangles. */
function torus() {
  const [n, m] = [64, 40];
  const [points, faces] = [[], []];
  for (let i = 0; i < n; i += 1) {
    for (let j = 0; j < m; j += 1) {
      const [u, v] = [(2 * Math.PI * i) / n, (2 * Math.PI * j) / m];
      points.push([(3 + Math.cos(v)) * Math.cos(u), (3 + Math.cos(v)) * Math.sin(u), Math.sin(v)]);
      const [a, b, c, d] = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]].map(([x, y]) => (x % n) * m + (y % m));
      faces.push([3, a, b, c], [3, a, c, d]);
    }
  }
  return `OFF\n${points.length} ${faces.length} 0\n${[...points, ...faces].map((row) => row.join(" ")).join("\n")}\n`;
}

test("levels of detail of exact models", async () => {
  const [off, path, obj] = ["torus.off", "torus.goblin", "coarse.obj"].map((name) => join(work, name));
  writeFileSync(off, torus());
  spinney("build", "-q", off, "-o", path, "--brep", "--snap", "0.001", "--levels");
  const model = await open(path);
  const { levels } = model.header;
  const expected = spinneyJson("info", "--json", path).levels;
  const named = levels.map(({ vanishedBodies, vanishedDiameter, ...rest }) => ({ ...rest, vanished_bodies: vanishedBodies, vanished_diameter: vanishedDiameter }));
  same(named, expected);
  assert.ok(levels.length > 2);
  const details = [...levels.keys()].map((level) => ({ level }));
  for (const detail of [...details, { error: 0.01 }, { faces: levels[0].faces }]) {
    const [[option, value]] = Object.entries(detail);
    spinney("export", "-q", path, obj, "--triangles", `--${option}`, value);
    const { vertices, faces } = readObj(obj);
    const mesh = await model.mesh(detail);
    assert.equal(mesh.triangles, faces.length);
    assert.deepEqual([mesh.indices.length, mesh.positions.length], [3 * faces.length, 3 * vertices.length]);
    assert.equal(mesh.colours, null);
    assert.ok(mesh.error <= (detail.error ?? levels[0].error));
    const at = (corner) => [0, 1, 2].map((axis) => mesh.positions[3 * corner + axis] + mesh.origin[axis]);
    const volumes = [volumeOf(at, trianglesOf(mesh)), volumeOf((corner) => vertices[corner], faces)];
    assert.ok(Math.abs(volumes[0] - volumes[1]) <= 1e-5 * volumes[1], `${volumes}`);
    const edges = new Set(trianglesOf(mesh).flatMap(([a, b, c]) => [`${a} ${b}`, `${b} ${c}`, `${c} ${a}`]));
    for (const edge of edges) assert.ok(edges.has(edge.split(" ").reverse().join(" ")), "the surface is closed");
  }
  assert.equal((await model.mesh()).triangles, model.header.faces);
  await assert.rejects(model.mesh({ clusters: [0], level: 0 }), { code: "invalid" });
  await assert.rejects(model.mesh({ clusters: [0], bounds: [0, 0, 0, 1, 1, 1] }), { code: "invalid" });
  await assert.rejects(model.mesh({ clusters: [1e6] }), { code: "invalid", message: /cluster/ });
  const near = await model.mesh({ bounds: [3, -1, -1, 5, 1, 1] });
  assert.ok(near.triangles > 0 && near.triangles < model.header.faces);
  await assert.rejects(model.mesh({ level: levels.length }), { code: "invalid" });
  await assert.rejects(model.mesh({ level: 0, faces: 100 }), { code: "invalid" });
});

test("surfaces for a viewpoint", async () => {
  const [off, path] = ["seen.off", "seen.goblin"].map((name) => join(work, name));
  writeFileSync(off, torus());
  spinney("build", "-q", off, "-o", path, "--brep", "--snap", "0.001", "--levels");
  const model = await open(path);
  const { faces, levels } = model.header;
  const views = {
    far: { eye: [1e6, 0, 0], tolerance: 1e-3 },
    unseen: { eye: [4.1, 0, 0], tolerance: 1e-3, halfSpaces: [[1, 0, 0, -10]] },
    few: { eye: [4.1, 0, 0], tolerance: 0, faces: 2000 },
    exact: { eye: [4.1, 0, 0], tolerance: 0 },
  };
  const meshes = {};
  for (const [name, view] of Object.entries(views)) {
    const cut = await model.cut(view);
    // (In two requests, as clusters that are new are requested.)
    const half = cut.clusters.length >> 1;
    let volume = 0;
    let triangles = 0;
    const surplus = new Map();
    for (const clusters of [cut.clusters.slice(0, half), cut.clusters.slice(half)].filter(({ length }) => length > 0)) {
      const mesh = await model.mesh({ clusters });
      assert.deepEqual(mesh.clusters.map(({ number }) => number), clusters);
      assert.equal(mesh.clusters.at(-1).end, mesh.triangles);
      assert.ok(mesh.error <= cut.error);
      // (Clusters share no vertices.)
      const owner = new Map();
      mesh.clusters.forEach(({ end }, index) => {
        const start = index === 0 ? 0 : mesh.clusters[index - 1].end;
        for (const vertex of mesh.indices.subarray(3 * start, 3 * end)) {
          assert.equal(owner.get(vertex) ?? index, index);
          owner.set(vertex, index);
        }
      });
      const at = (corner) => [0, 1, 2].map((axis) => mesh.positions[3 * corner + axis]);
      volume += volumeOf(at, trianglesOf(mesh));
      for (const corners of trianglesOf(mesh)) {
        corners.map((corner) => at(corner).join()).forEach((from, index, all) => {
          const to = all[(index + 1) % 3];
          const [edge, sign] = from < to ? [`${from} ${to}`, 1] : [`${to} ${from}`, -1];
          surplus.set(edge, (surplus.get(edge) ?? 0) + sign);
        });
      }
      triangles += mesh.triangles;
    }
    assert.equal(triangles, cut.faces);
    assert.ok([...surplus.values()].every((number) => number === 0), `${name}: the surface is closed`);
    meshes[name] = { triangles, volume };
  }
  assert.deepEqual([meshes.far.triangles, meshes.unseen.triangles, meshes.exact.triangles], [levels[0].faces, levels[0].faces, faces]);
  assert.ok(meshes.few.triangles > levels[0].faces && meshes.few.triangles <= 2000, `${meshes.few.triangles} triangles`);
  assert.ok(Math.abs(meshes.few.volume / meshes.exact.volume - 1) < 0.1);
  await assert.rejects(model.cut({ eye: [0, 0, 0], tolerance: -1 }), { code: "invalid" });
  await assert.rejects(model.cut({ eye: [0, 0, 0], tolerance: 1, faces: 1 }), { code: "invalid", message: /at least/ });
  await assert.rejects(model.cut({ tolerance: 1 }), { code: "invalid" });
});
