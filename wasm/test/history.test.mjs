// Commits, their differences, and files to which new ones are appended.

import assert from "node:assert/strict";
import { copyFileSync } from "node:fs";
import { join } from "node:path";
import test from "node:test";

import { open } from "../../crates/site/page/spinney/index.js";
import { frozen, same, spinney, spinneyJson, temporaryDirectory } from "./helpers.mjs";

const work = temporaryDirectory();

for (const name of ["history.autumn", "stack.autumn"]) {
  test(`commits of ${name}`, async () => {
    const path = join(frozen, name);
    const file = await open(path);
    const commits = await file.commits();
    same(commits, spinneyJson("log", "--json", path));
    same(await file.commits({ limit: 1 }), commits.slice(0, 1));
    for (const { number } of commits) {
      const old = await file.openCommit(number);
      same(old.header.commit.number, number);
      const layer = old.header.layer ? `:${old.header.layer}` : "";
      same(await old.stats(), spinneyJson("stats", "--json", `${path}@${number}${layer}`));
      same((await (await open(path, { commit: number })).stats()).cells, (await old.stats()).cells);
      const expected = spinneyJson("diff", "--json", `${path}@${number}${layer}`, `${path}${layer}`);
      const found = await file.diff(number);
      same([found.added, found.removed, found.changed, found.blockCount], [expected.added, expected.removed, expected.changed, expected.blocks]);
      same(found.blocks.length, expected.blocks);
      same(await file.diff(number, commits[0].number), found);
      const cells = found.blocks.reduce((sum, { size }) => sum + size.reduce((product, length) => product * length, 1), 0);
      same(found.changedCells, cells);
    }
    await assert.rejects(file.openCommit(99), { name: "SpinneyError", message: /99/ });
    await assert.rejects(file.diff(99), { name: "SpinneyError", message: /99/ });
  });
}

test("differences of a region", async () => {
  const file = await open(join(frozen, "history.autumn"));
  const all = await file.diff(1);
  const [width, height] = file.header.size;
  const half = Math.floor(width / 2);
  const [west, east] = [await file.diff(1, undefined, { cells: [0, 0, half, height] }), await file.diff(1, undefined, { cells: [half, 0, width, height] })];
  same(west.changedCells + east.changedCells, all.changedCells);
  assert.equal((await file.diff(1, undefined, { limit: 1 })).blocks.length, Math.min(1, all.blocks.length));
});

test("a commit that is appended meanwhile is read after refresh", async () => {
  const path = join(work, "edited.autumn");
  copyFileSync(join(frozen, "history.autumn"), path);
  const file = await open(path);
  const before = file.header.commit.number;
  assert.equal(await file.refresh(), false);
  const fresh = await open(path);
  const expected = await file.stats();
  spinney("edit", "-q", path, "fill", "--window", "3,3,20,20", "--value", "3", "-m", "more");
  same(await fresh.stats(), expected, "readers keep their commit");
  assert.equal(await file.refresh(), true);
  assert.ok(file.header.commit.number > before);
  assert.equal((await file.commits())[0].message, "more");
  same(await file.stats(), spinneyJson("stats", "--json", path));
  const { changedCells } = await file.diff(before);
  assert.ok(changedCells > 0);
});
