// Images, tiles and legends, against the program's.

import assert from "node:assert/strict";
import { basename, join } from "node:path";
import test from "node:test";

import { open } from "../../crates/site/page/spinney/index.js";
import { files, serve, spinney, temporaryDirectory } from "./helpers.mjs";
import { alike, readPng } from "./png.mjs";

const { cells, made } = files();
const work = temporaryDirectory();

for (const path of cells) {
  test(`images of ${basename(path)}`, async () => {
    const map = await open(path);
    const { header } = map;
    if (header.dimension !== 2 || header.layers.length > 1) return;
    const styles = header.channels === 1 ? ["viridis", "hillshade", undefined] : [undefined];
    const half = header.size.map((size) => Math.max(1, Math.floor(size / 2)));
    for (const style of styles) {
      for (const level of [header.depth, header.depth - 1]) {
        for (const cells of [undefined, [Math.floor(half[0] / 2), 0, half[0] + 1, half[1]]]) {
          const png = join(work, "image.png");
          const window = cells && [cells[0], cells[1], cells[2] - cells[0], cells[3] - cells[1]].join(",");
          // (Without a style the program writes the values themselves, if these fit.)
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

test("tiles are those that the server sends", async (t) => {
  const server = await serve(made);
  t.after(() => server.stop());
  for (const name of ["island_classes_packed.goblin", "island_elevation.goblin"]) {
    const path = join(made, name);
    const map = await open(path);
    const style = name.includes("classes") ? undefined : "terrain";
    let count = 0;
    const { maxzoom } = await (await fetch(`${server.url}tiles/${name}.json`)).json();
    for (let z = maxzoom - 3; z <= maxzoom; z += 1) {
      const side = 2 ** z;
      const [west, south, east, north] = map.header.geographicBounds;
      const column = (lon) => Math.floor(((lon + 180) / 360) * side);
      const row = (lat) => Math.floor(((1 - Math.asinh(Math.tan((lat * Math.PI) / 180)) / Math.PI) / 2) * side);
      for (let x = column(west); x <= column(east); x += 1) {
        for (let y = row(north); y <= row(south); y += 1) {
          const tile = await map.tile({ z, x, y, style });
          const address = `${server.url}tiles/${name}/${z}/${x}/${y}.png${style ? `?style=${style}` : ""}`;
          const response = await fetch(address);
          assert.equal(response.ok, true, address);
          // (Tiles without content do not exist.)
          if (response.status === 204) {
            assert.equal(tile, null, address);
            continue;
          }
          count += 1;
          alike(tile, readPng(new Uint8Array(await response.arrayBuffer())), address);
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
