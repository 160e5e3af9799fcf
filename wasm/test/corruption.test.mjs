// Truncated and corrupt files: an error or a result, but never the end of the module.

import assert from "node:assert/strict";
import { basename } from "node:path";
import test from "node:test";

import { open, PanicError, SpinneyError } from "../../crates/site/page/spinney/index.js";
import { bytesOf, files, random } from "./helpers.mjs";

const { cells, models } = files();

/** Runs all queries; returns the errors. */
async function queryAll(bytes) {
  const errors = [];
  const tried = async (work) => {
    try {
      return await work();
    } catch (error) {
      assert.ok(error instanceof SpinneyError && !(error instanceof PanicError), `${error.stack}`);
      assert.ok(error.message.length > 0);
      errors.push(error);
      return undefined;
    }
  };
  const dataset = await tried(() => open(new Blob([bytes])));
  if (!dataset) return errors;
  if (dataset.header.kind === "model") {
    const { bounds } = dataset.header;
    await tried(() => dataset.measures());
    await tried(() => dataset.triangles());
    await tried(() => dataset.mesh());
    if (bounds) {
      const middle = [0, 1, 2].map((axis) => (bounds[axis] + bounds[axis + 3]) / 2);
      await tried(() => dataset.section({ axis: "z", at: middle[2] }));
      await tried(() => dataset.contains(middle));
    }
  } else {
    await tried(() => dataset.window({ size: 32 }));
    await tried(() => dataset.window({ cells: dataset.header.dimension === 3 ? [0, 0, 0, 40, 40, 4] : [0, 0, 90, 90] }));
    await tried(() => dataset.stats());
    await tried(() => dataset.find({ where: { above: 2 }, limit: 100 }));
    await tried(() => dataset.points([dataset.header.bounds.slice(0, dataset.header.dimension)]));
    if (dataset.header.format === "autumnal") await tried(() => dataset.commits({ limit: 10 }));
  }
  dataset.close();
  return errors;
}

for (const path of [...cells, ...models]) {
  test(`corruption of ${basename(path)}`, async () => {
    const whole = bytesOf(path);
    assert.deepEqual(await queryAll(whole), []);
    const next = random(whole.length);
    for (let time = 0; time < 12; time += 1) {
      const cut = whole.subarray(0, Math.floor(next() * whole.length));
      const errors = await queryAll(cut);
      // (An Autumnal file may have complete first commits.)
      if (!path.endsWith(".autumn")) assert.ok(errors.length > 0, `cut to ${cut.length} bytes`);
      const flipped = whole.slice();
      for (let byte = 0; byte < 1 + (time % 3) * 20; byte += 1) flipped[Math.floor(next() * flipped.length)] ^= 1 << Math.floor(next() * 8);
      await queryAll(flipped);
    }
    assert.deepEqual(await queryAll(whole), [], "the module still works");
  });
}
