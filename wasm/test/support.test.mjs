// Engines without features that the module needs: an error that says so.

import assert from "node:assert/strict";
import { join } from "node:path";
import test from "node:test";

import { open, SpinneyError } from "../../crates/site/page/spinney/index.js";
import { frozen } from "./helpers.mjs";

test("an engine without SIMD is named, and the next attempt loads the module", async () => {
  const { validate } = WebAssembly;
  WebAssembly.validate = () => false;
  try {
    await assert.rejects(open(join(frozen, "classes.goblin")), (error) => {
      assert.ok(error instanceof SpinneyError);
      assert.equal(error.code, "unsupported");
      assert.match(error.message, /SIMD.*Safari 16\.4/);
      return true;
    });
  } finally {
    WebAssembly.validate = validate;
  }
  (await open(join(frozen, "classes.goblin"))).close();
});
