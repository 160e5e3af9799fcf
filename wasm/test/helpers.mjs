// Common helpers: the program, with whose results the module's are compared, and files of all
// kinds.

import assert from "node:assert/strict";
import { execFileSync, spawn } from "node:child_process";
import { existsSync, mkdirSync, mkdtempSync, readdirSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { basename, join } from "node:path";
import { fileURLToPath } from "node:url";

export const root = fileURLToPath(new URL("../..", import.meta.url));
export const frozen = join(root, "fixtures/v1");
/** The program. */
export const program = process.env.SPINNEY ?? join(root, "target/debug/spinney");

/** Runs the program; returns its standard output. */
export function spinney(...list) {
  return execFileSync(program, list.map(String), { encoding: "utf8", maxBuffer: 2 ** 28, stdio: ["ignore", "pipe", "pipe"] });
}

/** Starts a server of the program for a directory; returns its URL, and how to stop it. */
export async function serve(path) {
  const server = spawn(program, ["serve", path, "--port", "0"], { stdio: ["ignore", "pipe", "pipe"] });
  const url = await new Promise((resolve, reject) => {
    let text = "";
    const take = (data) => {
      text += data;
      const found = /http:\/\/[\d.]+:\d+\//.exec(text);
      if (found) resolve(found[0]);
    };
    server.stdout.on("data", take);
    server.stderr.on("data", take);
    server.on("exit", (code) => reject(new Error(`the server ended with ${code}: ${text}`)));
  });
  return { url, stop: () => server.kill() };
}

/** Runs the program; parses the JSON that it prints, with numbers beyond doubles as BigInts. */
export function spinneyJson(...list) {
  return read(spinney(...list));
}

/** Runs the program, which prints JSON line by line. */
export function spinneyJsonLines(...list) {
  return spinney(...list).split("\n").filter(Boolean).map(read);
}

function read(text) {
  const marked = text.replace(/([[:,]\s*)(-?\d{16,})(?=\s*[,\]}])/g, '$1{"$big":"$2"}');
  return JSON.parse(marked, (_, value) => (value?.$big === undefined ? value : BigInt(value.$big)));
}

/** A directory for a test file, which is removed afterwards. */
export function temporaryDirectory() {
  const path = mkdtempSync(join(tmpdir(), "spinney-wasm-"));
  process.on("exit", () => rmSync(path, { recursive: true, force: true }));
  return path;
}

/**
 * Files of all kinds: the frozen ones, those made from the fixtures, and all of them in other
 * formats and packings.
 */
export function files() {
  const made = process.env.SPINNEY_FILES ?? temporaryDirectory();
  if (!existsSync(join(made, "done"))) makeFiles(made);
  const of = (path) => readdirSync(path).filter((name) => /\.(goblin|autumn)$/.test(name)).map((name) => join(path, name));
  const isModel = (path) => /^(chapel|crossing|cube)/.test(basename(path));
  const all = [...of(frozen), ...of(made)];
  return { cells: all.filter((path) => !isModel(path)), models: all.filter(isModel), made };
}

function makeFiles(made) {
  rmSync(made, { recursive: true, force: true });
  mkdirSync(made, { recursive: true });
  const fixtures = join(root, "fixtures");
  const at = (name) => join(made, name);
  for (const name of ["island_classes", "island_elevation"]) {
    spinney("build", "-q", join(fixtures, `${name}.tif`), "-o", at(`${name}.goblin`));
    spinney("build", "-q", join(fixtures, `${name}.tif`), "-o", at(`${name}.autumn`));
    spinney("convert", "-q", at(`${name}.goblin`), "-o", at(`${name}_packed.goblin`), "--codec", "packed");
    spinney("compact", "-q", at(`${name}.autumn`), "-o", at(`${name}_packed.autumn`), "--pack");
  }
  for (const name of ["ball", "stack", "rgba", "segments"]) {
    spinney("convert", "-q", join(frozen, `${name}.goblin`), "-o", at(`${name}_packed.goblin`), "--codec", "packed");
    spinney("convert", "-q", join(frozen, `${name}.goblin`), "-o", at(`${name}.autumn`));
  }
  execFileSync("touch", [at("done")]);
}

/** Asserts that two results are equal; BigInts equal numbers. */
export function same(found, expected, message) {
  assert.deepEqual(plain(found), plain(expected), message);
}

/**
 * Asserts that two results are equal except for the last digits of sums in another order; `loose`
 * are members that may differ more.
 */
export function near(found, expected, message, loose = []) {
  const [a, b] = [plain(found), plain(expected)];
  const compare = (a, b, path) => {
    if (typeof a === "number" && typeof b === "number") {
      const tolerance = (loose.includes(path.at(-1)) ? 0.1 : 1e-9) * Math.max(Math.abs(a), Math.abs(b), 1e-3);
      if (!(Math.abs(a - b) <= tolerance)) assert.fail(`${message}: ${path.join(".")} is ${a}, not ${b}`);
    } else if (a && b && typeof a === "object" && typeof b === "object") {
      assert.deepEqual(Object.keys(a), Object.keys(b).filter((name) => b[name] !== undefined), `${message}: ${path.join(".")}`);
      for (const name of Object.keys(a)) compare(a[name], b[name], [...path, name]);
    } else {
      assert.deepEqual(a, b, `${message}: ${path.join(".")}`);
    }
  };
  compare(a, b, []);
}

function plain(value) {
  if (typeof value === "bigint") return value >= -(2n ** 53n) && value <= 2n ** 53n ? Number(value) : String(value);
  if (Array.isArray(value)) return value.map(plain);
  if (value && typeof value === "object") {
    return Object.fromEntries(Object.entries(value).filter(([, each]) => each !== undefined).map(([name, each]) => [name, plain(each)]));
  }
  return value;
}

/** Pseudo-random numbers from 0 to 1, with a fixed seed. */
export function random(seed = 1) {
  let state = seed;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
  };
}

/** The bytes of a file. */
export const bytesOf = (path) => new Uint8Array(readFileSync(path));

/** Layers of a file, by the program's names. */
export const layersOf = (header) => header.layers.map((layer) => layer.name);
