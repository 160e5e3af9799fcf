// Datasets that are open in a worker, with the same methods.

import { fromParts } from "./errors.js";
import { image } from "./images.js";

let start = () => new Worker(new URL("./worker.js", import.meta.url), { type: "module", name: "spinney" });
let worker;
let next = 0;
const waiting = new Map();

/** Sets how the worker is started, if it is not next to this file. */
export function setWorker(make) {
  start = make;
}

function theWorker() {
  if (worker) return worker;
  worker = start();
  const listen = (name, handle) => (worker.addEventListener ? worker.addEventListener(name, handle) : worker.on(name, (data) => handle({ data, message: data?.message })));
  listen("message", ({ data }) => {
    const pending = waiting.get(data.id);
    if (!pending) return;
    if (data.progress) {
      pending.progress?.(data.progress);
      return;
    }
    waiting.delete(data.id);
    pending.done();
    if (data.error) pending.reject(fromParts(data.error));
    else pending.resolve(data.found);
  });
  listen("error", ({ message }) => {
    // (The worker cannot continue: pending queries fail, and the next one starts another worker.)
    worker = undefined;
    for (const pending of waiting.values()) {
      pending.done();
      pending.reject(fromParts({ name: "PanicError", message: `the worker failed: ${message}` }));
    }
    waiting.clear();
  });
  return worker;
}

/** Lets a worker read through a port what this thread reads. */
function portOf(reader) {
  const { port1, port2 } = new MessageChannel();
  port1.onmessage = async ({ data: { id, start, end } }) => {
    try {
      const bytes = await reader.read(start, end);
      port1.postMessage({ id, bytes });
    } catch (error) {
      port1.postMessage({ id, failure: String(error?.message ?? error) });
    }
  };
  return port2;
}

/** Calls a method in the worker. */
function call(of, method, list, { signal, progress } = {}, transferred = []) {
  return new Promise((resolve, reject) => {
    if (signal?.aborted) {
      reject(signal.reason);
      return;
    }
    next += 1;
    const id = next;
    const to = theWorker();
    const abort = () => {
      waiting.delete(id);
      to.postMessage({ abort: id });
      reject(signal.reason);
    };
    signal?.addEventListener("abort", abort, { once: true });
    const done = () => signal?.removeEventListener("abort", abort);
    waiting.set(id, { resolve, reject, progress, done });
    try {
      to.postMessage({ id, of, method, list: list.map(sendable), wantsProgress: Boolean(progress) }, transferred);
    } catch (error) {
      waiting.delete(id);
      done();
      reject(error);
    }
  });
}

/** An argument without properties that cannot be sent. */
function sendable(value) {
  if (value instanceof URL) return value.href;
  if (value === null || typeof value !== "object" || Object.getPrototypeOf(value) !== Object.prototype) return value;
  const { signal, progress, ...rest } = value;
  return rest;
}

/** The options among arguments: the last one, if it has any. */
function optionsOf(list) {
  const last = list.at(-1);
  return last !== null && typeof last === "object" ? { signal: last.signal, progress: last.progress } : {};
}

class RemoteOpened {
  #number;

  constructor({ number, header, warnings, methods }) {
    this.#number = number;
    this.header = header;
    this.warnings = warnings;
    for (const method of methods) {
      this[method] = async (...list) => found(await call(this.#number, method, list, optionsOf(list)));
    }
  }

  async refresh(options = {}) {
    const { has, header, warnings } = await call(this.#number, "refresh", [options], options);
    if (has) Object.assign(this, { header, warnings });
    return has;
  }

  close() {
    call(this.#number, "close", []).catch(() => {});
  }
}

/** Converts a result: opened objects get methods, images the platform's type. */
function found(result) {
  if (result?.isImage) return image(result.data, result.width, result.height, result);
  return result?.isOpened ? new RemoteOpened(result) : result;
}

/** Opens a file in a worker; the first call starts it. */
export async function openInWorker(source, options = {}) {
  const base = globalThis.location?.href;
  const place = typeof source === "string" && base && !/^[a-z][a-z0-9+.-]+:/i.test(source) ? new URL(source, base).href : source;
  if (typeof source?.read !== "function") return found(await call(undefined, "open", [place, options], options));
  const port = portOf(source);
  return found(await call(undefined, "open", [{ name: source.name, size: source.size, port }, options], options, [port]));
}
