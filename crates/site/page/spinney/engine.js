// The WebAssembly module: one instance at a time, with its open files and trees.

import * as glue from "./module.js";
import { PanicError, SpinneyError } from "./errors.js";

/** Size in bytes of the range cache for all files. */
const CACHE = 64 * 2 ** 20;
/** Maximum bytes that a single query may need at the same time. */
const MAX_NEEDED = 2 ** 30;

/**
 * Number of batches after which single ranges are fetched with read-ahead, and the initial and
 * maximum read-ahead in bytes.
 */
const ALONE = 6;
const FIRST_AHEAD = 2 ** 18;
const MAX_AHEAD = 2 ** 23;

const isNode = typeof process !== "undefined" && Boolean(process.versions?.node) && typeof document === "undefined";

let compiled;
let ready = false;
/** Number of the instance. Objects that were opened in an older one do not exist any more. */
let generation = 0;
let cache = CACHE;

/**
 * Sets the source of the module: a URL, bytes, a response, a compiled module, or a promise of one
 * of these. The default is a file next to this one.
 */
export function setModule(source) {
  if (ready || compiled) throw new SpinneyError({ code: "invalid", message: "the module is already loaded; call setModule() before the first file is opened" });
  compiled = compile(source);
  // (Callers that await it get the error.)
  compiled.catch(() => {});
}

/** A function with 128-bit vectors, which the module also uses. */
const SIMD = new Uint8Array([0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 10, 1, 8, 0, 65, 0, 253, 15, 253, 98, 11]);

async function compileBytes(bytes) {
  if (!WebAssembly.validate(SIMD)) {
    const message = "this WebAssembly engine has no SIMD (simd128), which the module needs; use Chrome 91, Firefox 89, Safari 16.4, Node 16.4 or newer";
    throw new SpinneyError({ code: "unsupported", message });
  }
  return WebAssembly.compile(bytes);
}

async function compile(from) {
  const source = await from;
  if (source instanceof WebAssembly.Module) return source;
  if (source instanceof ArrayBuffer || ArrayBuffer.isView(source)) return compileBytes(source);
  const url = source ?? new URL("./module_bg.wasm", import.meta.url);
  if (isNode && new URL(url, "file:///").protocol === "file:") {
    const { readFile } = await import(/* webpackIgnore: true */ /* @vite-ignore */ "node:fs/promises");
    return compileBytes(await readFile(new URL(url, "file:///")));
  }
  const response = url instanceof Response ? url : await fetch(url);
  if (!response.ok) throw new SpinneyError({ code: "io", message: `${response.url}: cannot fetch the module: the host returned ${response.status}`, file: response.url });
  return compileBytes(await response.arrayBuffer());
}

/** Loads the module, once. */
export async function load() {
  compiled ??= compile();
  let module;
  try {
    module = await compiled;
  } catch (error) {
    // (The next attempt may succeed.)
    compiled = undefined;
    throw error;
  }
  if (!ready) {
    glue.initSync({ module });
    glue.setCache(cache);
    ready = true;
    generation += 1;
  }
}

/** The number of the instance. */
export function instance() {
  return generation;
}

/** Sets the size in bytes of the range cache for all files. */
export function setCacheBytes(bytes) {
  cache = Math.min(Math.max(bytes, 2 ** 20), MAX_NEEDED);
  if (ready) glue.setCache(cache);
}

/** Calls the module. A panic ends the instance, not the page: a new instance replaces it. */
export function call(work) {
  try {
    return work(glue);
  } catch (error) {
    if (error instanceof SpinneyError) throw error;
    let message;
    try {
      message = glue.lastPanic();
    } catch {
      // (Reading the message may fail, too.)
    }
    ready = false;
    glue.__wbg_reset_state();
    glue.setCache(cache);
    ready = true;
    generation += 1;
    throw new PanicError({ message: `the module panicked: ${message ?? error}` }, { cause: error });
  }
}

/** Tries a query once: returns `{missing}`, or `{json, buffers}`. */
function tryOnce(text, coordinates) {
  return call((glue) => {
    const result = glue.query(text, coordinates);
    try {
      const missing = result.missing;
      if (missing.length > 0) return { missing };
      const json = parse(result.text);
      if (result.isFailure) return { failure: json };
      return { json, take: (number) => result.take(number), result };
    } catch (error) {
      result.free();
      throw error;
    }
  });
}

/** Writes JSON in which BigInts are integers. */
function write(request) {
  let hasBig = false;
  const text = JSON.stringify(request, (_, value) => {
    if (typeof value !== "bigint") return value;
    hasBig = true;
    return `\u0000${value}`;
  });
  return hasBig ? text.replace(/"\\u0000(-?\d+)"/g, "$1") : text;
}

/** Parses JSON in which integers may be BigInts. */
export function parse(text) {
  if (!text.includes('{"$')) return JSON.parse(text);
  return JSON.parse(text, (_, value) => {
    if (value === null || typeof value !== "object") return value;
    if (typeof value.$big === "string") return BigInt(value.$big);
    if (typeof value.$float === "string") return value.$float === "inf" ? Infinity : -Infinity;
    return value;
  });
}

const NONE = new Float64Array(0);

/** Another query has ended the instance: this one must be repeated in the new one. */
export class Replaced extends Error {}

/**
 * Runs a query in batches: the ranges that it lacks are fetched, many at once, and it is tried
 * again. It can be aborted between two batches.
 *
 * @param files the file and its sources: `fetch(ranges, signal)` supplies their bytes.
 */
export async function query(files, request, { coordinates = NONE, signal, progress, buffers = 0 } = {}) {
  const text = write(request);
  const source = files.file;
  const fetched = new Set();
  const total = { batches: 0, requests: 0, bytes: 0 };
  const own = generation;
  let needed = 0;
  let ahead = 0;
  let hasGrown = false;
  try {
    for (;;) {
      signal?.throwIfAborted();
      if (own !== generation) throw new Replaced();
      const { missing, failure, json, take, result } = tryOnce(text, coordinates);
      if (failure) throw new SpinneyError(failure);
      if (!missing) {
        try {
          const found = [];
          for (let number = 0; number < buffers; number += 1) found.push(call(() => take(number)));
          return { json, buffers: found };
        } finally {
          if (own === generation) result.free();
        }
      }
      // Ranges by file: an index and its sources.
      const ranges = new Map();
      let isAgain = false;
      for (let at = 0; at < missing.length; at += 3) {
        const [file, start, end] = missing.subarray(at, at + 3);
        const key = `${file}:${start}:${end}`;
        isAgain ||= fetched.has(key);
        fetched.add(key);
        if (!ranges.has(file)) ranges.set(file, []);
        ranges.get(file).push([start, end]);
        needed += end - start;
      }
      // (A query that needs single ranges in turn scans the file: each is fetched with increasing
      // read-ahead.)
      if (missing.length === 3 && ranges.has(source.file) && total.batches >= ALONE) {
        ahead = Math.min(Math.max(2 * ahead, FIRST_AHEAD), MAX_AHEAD);
        const [range] = ranges.get(source.file);
        const end = source.aheadOf(range[1], range[1] + ahead);
        needed += Math.max(end - range[1], 0);
        range[1] = Math.max(end, range[1]);
      }
      // (All ranges that a query has read must be in the cache for its last attempt.)
      if (needed > cache / 2 || isAgain) {
        const capacity = Math.min(Math.max(4 * needed, 2 * cache), 2 * MAX_NEEDED);
        if (needed > MAX_NEEDED) {
          throw new SpinneyError({
            code: "too-large",
            message: `${source.name}: the query needs more than ${MAX_NEEDED} bytes of the file and its sources at the same time; request a smaller region or a coarser level`,
            file: source.name,
            advice: "request a smaller region or a coarser level",
          });
        }
        glue.setCache(capacity);
        hasGrown = true;
      }
      const { requests, bytes } = await files.fetch(ranges, signal);
      total.batches += 1;
      total.requests += requests;
      total.bytes += bytes;
      progress?.({ ...total });
    }
  } finally {
    if (hasGrown && own === generation) glue.setCache(cache);
  }
}

/** Adds a file whose bytes are supplied in ranges, or one whose bytes are complete. */
export const addFile = (name, length) => call((glue) => glue.addFile(name, length));
export const addBytes = (name, bytes) => call((glue) => glue.addBytes(name, bytes));
/** Describes a source of an index: name, length, and version when it was indexed. */
export const describeSource = (file) => JSON.parse(call((glue) => glue.describeSource(file)));
export const removeFile = (file) => call((glue) => glue.removeFile(file));
export const supply = (file, offset, bytes) => call((glue) => glue.supply(file, offset, bytes));
export const close = (opened) => call((glue) => glue.close(opened));
