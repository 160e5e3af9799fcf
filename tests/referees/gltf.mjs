// 3D Tiles and binary glTF as JavaScript readers see them: gltf-validator, 3d-tiles-tools,
// loaders.gl.
//
//     `NODE_DIRECTORY=PACKAGES node tests/referees/gltf.mjs TILESET... MODEL.glb...`
//
// `NODE_DIRECTORY` contains the packages. TILESET is a directory. A tileset X is compared with a
// sibling X.meshopt, if it exists; single models are only validated.

import assert from 'node:assert/strict';
import fs from 'node:fs';
import http from 'node:http';
import { createRequire } from 'node:module';
import path from 'node:path';

const require = createRequire(path.join(process.env.NODE_DIRECTORY, 'node_modules/'));
const validator = require('gltf-validator');
const { TilesetSources, TilesetTraverser, TilesetSourceResourceResolver } = require('3d-tiles-tools');
const { load, parse } = require('@loaders.gl/core');
const { Tiles3DLoader } = require('@loaders.gl/3d-tiles');
const { GLTFLoader, postProcessGLTF } = require('@loaders.gl/gltf');

const below = (directory) =>
  fs.readdirSync(directory, { recursive: true }).filter((name) => name.endsWith('.glb')).sort();

/**
 * The validator's messages, except about unknown extensions, and about unused views that only these
 * use.
 */
async function validate(file) {
  const { issues } = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)), { maxIssues: 100 });
  const isKnown = ({ code, message, pointer }) =>
    (code === 'UNSUPPORTED_EXTENSION' && /EXT_(meshopt|mesh_features|structural)/.test(message)) ||
    (code === 'UNUSED_OBJECT' && pointer.startsWith('/buffer'));
  assert.deepEqual(issues.messages.filter((message) => !isKnown(message)), [], file);
}

/** Tiles as traversed by 3d-tiles-tools: their contents, and their boxes. */
async function traverse(directory) {
  const source = await TilesetSources.createAndOpen(directory);
  const json = JSON.parse((await source.getValue('tileset.json')).toString());
  const resolver = new TilesetSourceResourceResolver('.', source);
  const contents = new Map();
  await new TilesetTraverser('.', resolver).traverse(json, async (traversed) => {
    const tile = traversed.asFinalTile();
    const parent = traversed.getParent()?.asFinalTile();
    // The tile that declares the implicit tiling is also the first implicit tile.
    if (tile.implicitTiling) return true;
    if (parent && !parent.implicitTiling) assert.equal(parent.geometricError, 2 * tile.geometricError);
    for (const content of traversed.getFinalContents()) {
      contents.set(content.uri, tile.boundingVolume.box);
    }
    return true;
  });
  await source.close();
  return contents;
}

/** Vertices of all triangles of a file in its root's coordinates, and their normals. */
async function triangles(file) {
  const gltf = postProcessGLTF(await parse(fs.readFileSync(file), GLTFLoader, { worker: false }));
  const found = [];
  for (const node of gltf.nodes.filter((node) => node.mesh)) {
    const { attributes, indices } = node.mesh.primitives[0];
    // Strides are larger than elements whose size is not a multiple of four bytes.
    const at = (attribute, vertex) => {
      const { value, components, bytesPerElement, bytesPerComponent } = attribute;
      const stride = (attribute.bufferView?.byteStride ?? bytesPerElement) / bytesPerComponent;
      const width = value.length >= stride * attribute.count - (stride - components) ? stride : components;
      return [...value.subarray(vertex * width, vertex * width + 3)];
    };
    for (let i = 0; i < indices.value.length; i += 3) {
      found.push([...indices.value.subarray(i, i + 3)].map((vertex) => ({
        at: at(attributes.POSITION, vertex).map((x, axis) => x * node.scale[axis] + node.translation[axis]),
        normal: at(attributes.NORMAL, vertex),
      })));
    }
  }
  return found;
}

/** Text of a triangle, independent of its first vertex. */
function written(triangle) {
  const corners = triangle.map(({ at, normal }) => [...at, ...normal].join(' '));
  const first = corners.indexOf(corners.toSorted()[0]);
  return [0, 1, 2].map((i) => corners[(first + i) % 3]).join(', ');
}

/** The tree of tiles that loaders.gl builds from the subtrees. */
async function loaded(directory) {
  const server = http.createServer((request, response) => {
    const file = path.join(directory, new URL(request.url, 'http://x').pathname);
    response.statusCode = fs.existsSync(file) ? 200 : 404;
    response.end(response.statusCode === 200 ? fs.readFileSync(file) : undefined);
  });
  await new Promise((resolve) => server.listen(0, '127.0.0.1', resolve));
  const base = `http://127.0.0.1:${server.address().port}/`;
  const { root } = await load(`${base}tileset.json`, Tiles3DLoader, { worker: false });
  server.close();
  const contents = [];
  const walk = (tile) => {
    if (tile.contentUrl) contents.push(tile.contentUrl.slice(base.length));
    tile.children?.forEach(walk);
  };
  walk(root);
  return contents;
}

const models = process.argv.slice(2).filter((name) => name.endsWith('.glb'));
for (const model of models) {
  await validate(model);
  console.log(`${path.basename(model)}: valid`);
}

for (const directory of process.argv.slice(2).filter((name) => !models.includes(name))) {
  const files = below(directory);
  for (const file of files) await validate(path.join(directory, file));
  const contents = await traverse(directory);
  assert.deepEqual([...contents.keys()].sort(), files, `3d-tiles-tools: ${directory}`);
  assert.deepEqual((await loaded(directory)).sort(), files, `loaders.gl: ${directory}`);
  let count = 0;
  for (const file of files) {
    const all = await triangles(path.join(directory, file));
    count += all.length;
    // Boxes are parallel to the tileset's axes; contents have the scale of their root's matrix.
    const gltf = await parse(fs.readFileSync(path.join(directory, file)), GLTFLoader, { worker: false });
    const unit = gltf.json.nodes[0].matrix[0];
    const box = contents.get(file);
    for (const { at } of all.flat()) {
      for (const axis of [0, 1, 2]) {
        const off = Math.abs(at[axis] * unit - box[axis]) - box[3 + 4 * axis];
        assert.ok(off <= 1e-9 * Math.abs(box[3 + 4 * axis]), `${directory}/${file}: ${at} is not in ${box}`);
      }
    }
    const compressed = path.join(`${directory}.meshopt`, file);
    if (fs.existsSync(compressed)) {
      await validate(compressed);
      const others = (await triangles(compressed)).map(written).sort();
      assert.deepEqual(others, all.map(written).sort(), compressed);
    }
  }
  const besides = fs.existsSync(`${directory}.meshopt`) ? ', the same as compressed ones' : '';
  console.log(`${path.basename(directory)}: ${files.length} contents, ${count} triangles${besides}`);
}
