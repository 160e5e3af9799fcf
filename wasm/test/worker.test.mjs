// Datasets in a worker return the same results as those in this thread.

import assert from "node:assert/strict";
import { join } from "node:path";
import test, { after } from "node:test";
import { Worker } from "node:worker_threads";

import { open, openInWorker, setWorker, SpinneyError } from "../../crates/site/page/spinney/index.js";
import { frozen, same } from "./helpers.mjs";

let worker;
setWorker(() => {
  worker = new Worker(new URL("../../crates/site/page/spinney/worker.js", import.meta.url));
  worker.unref();
  return worker;
});
after(() => worker?.terminate());

test("all queries", async () => {
  const path = join(frozen, "history.autumn");
  const [here, there] = [await open(path), await openInWorker(path)];
  same(there.header, here.header);
  const { bounds } = here.header;
  const point = [(bounds[0] + bounds[2]) / 2, (bounds[1] + bounds[3]) / 2];
  same(await there.window({ level: 2 }), await here.window({ level: 2 }));
  same(await there.point(point), await here.point(point));
  same(await there.points([point, point]), await here.points([point, point]));
  same(await there.stats(), await here.stats());
  same(await there.histogram(), await here.histogram());
  same(await there.find({ where: { above: 2 } }), await here.find({ where: { above: 2 } }));
  same(await there.commits(), await here.commits());
  same(await there.diff(1), await here.diff(1));
  same(await (await there.openCommit(1)).stats(), await (await here.openCommit(1)).stats());
  const [w, s, e, n] = bounds;
  const zone = { type: "Polygon", coordinates: [[[w, s], [e, s], [e, n], [w, s]]] };
  same(await there.zonal(zone, { crs: "world" }), await here.zonal(zone, { crs: "world" }));
  assert.equal(await there.refresh(), false);
  same(await there.image({ style: "viridis" }), await here.image({ style: "viridis" }));
  same(await there.legend(), await here.legend());
  same(await there.tile({ z: 0, x: 0, y: 0, grid: "native" }), await here.tile({ z: 0, x: 0, y: 0, grid: "native" }));
  const batches = [];
  const fresh = await openInWorker(path, { progress: (total) => batches.push(total.batches) });
  assert.ok(batches.length > 0);
  fresh.close();
  const model = await openInWorker(join(frozen, "chapel.goblin"));
  same(await model.measures(), await (await open(join(frozen, "chapel.goblin"))).measures());
  await assert.rejects(there.window({ level: 99 }), (error) => error instanceof SpinneyError && error.code === "invalid");
  await assert.rejects(openInWorker("nowhere.goblin"), (error) => error instanceof SpinneyError && error.code === "io");
  const control = new AbortController();
  control.abort();
  await assert.rejects(there.window({ signal: control.signal }), { name: "AbortError" });
  const later = new AbortController();
  const pending = there.window({ signal: later.signal });
  later.abort();
  await assert.rejects(pending, { name: "AbortError" });
  there.close();
  await assert.rejects(there.stats(), /closed/);
});
