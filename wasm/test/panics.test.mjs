// Panics: an error of the call, and the next one works.

import assert from "node:assert/strict";
import { join } from "node:path";
import test from "node:test";

import { open, PanicError } from "../../crates/site/page/spinney/index.js";
import { frozen, same } from "./helpers.mjs";

test("a panic is an error of its call alone", async () => {
  const path = join(frozen, "classes.goblin");
  const [first, second] = [await open(path), await open(join(frozen, "history.autumn"))];
  const expected = [await first.stats(), await second.stats()];
  for (let time = 0; time < 3; time += 1) {
    // (A pending query is repeated.)
    const meanwhile = second.window();
    await assert.rejects(first.query("panic"), (error) => {
      assert.ok(error instanceof PanicError);
      assert.equal(error.code, "panic");
      assert.match(error.message, /requested by a test/);
      return true;
    });
    same((await meanwhile).width, (await second.window()).width);
    same([await first.stats(), await second.stats()], expected);
  }
  same((await (await open(path)).stats()).cells, expected[0].cells);
  first.close();
  second.close();
});
