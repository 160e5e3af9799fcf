// The worker of `openInWorker`: queries its open datasets on request by messages.

import { Dataset, Model, open } from "./dataset.js";
import { setModule } from "./engine.js";
import { toParts } from "./errors.js";
import { packed } from "./images.js";
// (Imported here, so that they load together with the modules that need them.)
import "./indexed.js";
import "./module.js";
import "./ranges.js";
import "./sources.js";

const isNode = typeof self === "undefined";
const port = isNode ? (await import(/* webpackIgnore: true */ /* @vite-ignore */ "node:worker_threads")).parentPort : self;

/** Methods that can be called by messages, and the index of the argument with the options. */
const METHODS = {
  Dataset: {
    window: 0, point: 1, points: 1, stats: 0, zonal: 1, histogram: 0, find: 0, openLayer: 1, openCommit: 1, commits: 0,
    diff: 2, image: 0, tile: 0, legend: 0, slice: 0, geographic: 1, mesh: 0, contains: 1,
  },
  Model: { measures: 0, locate: 1, contains: 1, section: 0, cut: 0, triangles: 0, mesh: 0 },
};

/** The methods of an open object. */
const methodsOf = (dataset) => METHODS[dataset instanceof Model ? "Model" : "Dataset"];

const opened = new Map();
const running = new Map();
/** Resolves the promise of the announced module. */
let arrived;
let next = 0;

/** Registers an opened dataset; returns its description for the other thread. */
function keep(dataset) {
  next += 1;
  opened.set(next, dataset);
  return { isOpened: true, number: next, header: dataset.header, warnings: dataset.warnings, methods: Object.keys(methodsOf(dataset)) };
}

/** A source whose ranges arrive through a port. */
function readerOf({ name, size, port: from }) {
  const pending = new Map();
  let next = 0;
  from.onmessage = ({ data: { id, bytes, failure } }) => {
    const { resolve, reject } = pending.get(id);
    pending.delete(id);
    if (failure === undefined) resolve(bytes);
    else reject(new Error(failure));
  };
  const read = (start, end) =>
    new Promise((resolve, reject) => {
      next += 1;
      pending.set(next, { resolve, reject });
      from.postMessage({ id: next, start, end });
    });
  return { name, size, read };
}

async function respond({ of, method, list, options }) {
  if (method === "open") return keep(await open(list[0].port ? readerOf(list[0]) : list[0], { ...list[1], ...options }));
  const dataset = opened.get(of);
  if (!dataset) throw new TypeError("the dataset is closed");
  if (method === "close") {
    opened.delete(of);
    dataset.close();
    return undefined;
  }
  if (method === "refresh") {
    const has = await dataset.refresh(options);
    return { has, header: dataset.header, warnings: dataset.warnings };
  }
  const place = methodsOf(dataset)[method];
  list[place] = { ...list[place], ...options };
  const found = await dataset[method](...list);
  return found instanceof Dataset || found instanceof Model ? keep(found) : packed(found);
}

/** Arrays that are transferred instead of being copied. */
function transferred(found) {
  const buffers = new Set();
  for (const value of Object.values(found ?? {})) {
    if (ArrayBuffer.isView(value)) buffers.add(value.buffer);
  }
  return [...buffers];
}

async function take(message) {
  if (message.module === "later") {
    setModule(new Promise((resolve) => (arrived = resolve)));
    return;
  }
  if ("module" in message) {
    // (The worker cannot find the module itself, or it is loaded already: the first message
    // contains it, or announces a later one.)
    if (arrived) arrived(message.module);
    else setModule(message.module);
    return;
  }
  if (message.abort) {
    running.get(message.abort)?.abort();
    return;
  }
  const { id, wantsProgress } = message;
  const control = new AbortController();
  running.set(id, control);
  const progress = wantsProgress ? (traffic) => port.postMessage({ id, progress: traffic }) : undefined;
  try {
    const found = await respond({ ...message, options: { signal: control.signal, progress } });
    port.postMessage({ id, found }, transferred(found));
  } catch (error) {
    port.postMessage({ id, error: toParts(error) });
  } finally {
    running.delete(id);
  }
}

if (isNode) port.on("message", take);
else port.addEventListener("message", ({ data }) => take(data));
