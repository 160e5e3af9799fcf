// Sources of bytes: servers, files, memory.

import { SpinneyError } from "./errors.js";
import * as engine from "./engine.js";
import { between, each, join } from "./ranges.js";

/** Maximum number of concurrent requests. */
export const PARALLEL = 8;
/** Maximum size in bytes of a file that is read whole because its host does not serve ranges. */
const MAX_WHOLE = 64 * 2 ** 20;
/** Maximum size in bytes of a file whose rest is read once half of it has been. */
const MODERATE = 2 ** 23;
/** Bytes of the start and of the end that are fetched when a file is opened. */
const FIRST = 4096;
const LAST = 65536;
/**
 * Maximum number of event loop turns before ranges are fetched, while more ranges are still being
 * requested.
 */
const MAX_TURNS = 32;
/** Maximum retries of a request if the host is busy or the connection breaks. */
const REPEATS = 3;

export const isNode = typeof process !== "undefined" && Boolean(process.versions?.node) && typeof document === "undefined";

/** The bytes of a file. `start` adds it to the module; `fetch` supplies ranges of it. */
export class Source {
  /** The batch that is being collected, and the end of the running ones. */
  #next = undefined;
  #before = Promise.resolve();
  /** Ranges that have arrived since the newest batch was created. */
  #since = [];
  /** Fetched ranges, joined. (Some may have been evicted since.) */
  #fetched = [];
  /** Number of bytes that have arrived. */
  #came = 0;

  constructor(name) {
    this.name = name;
    /** Remarks for users. */
    this.warnings = [];
    this.file = undefined;
    this.instance = -1;
    /** Whether bytes may be appended to the file, such as commits. */
    this.grows = false;
  }

  /** Adds the file to the module's current instance. */
  add(length) {
    this.file = engine.addFile(this.name, length);
    this.instance = engine.instance();
    this.length = length;
  }

  addWhole(bytes) {
    this.file = engine.addBytes(this.name, bytes);
    this.instance = engine.instance();
    this.length = bytes.length;
  }

  /** Adds the file again, to another instance of the module. */
  async resume() {
    this.add(this.length);
  }

  supply(offset, bytes) {
    this.#fetched = join([...this.#fetched, [offset, offset + bytes.length]], 0, Infinity);
    // (If the instance was replaced meanwhile, no query waits for them.)
    if (this.instance === engine.instance()) engine.supply(this.file, offset, bytes);
  }

  /**
   * Fetches ranges. Requests that arrive while a batch is running form the next batch, so that no
   * range is fetched twice. A batch runs as long as a query waits for it.
   */
  async fetch(ranges, signal) {
    const batch = (this.#next ??= this.#gather());
    batch.ranges.push(...ranges);
    batch.waiting += 1;
    let stop;
    const aborted = new Promise((_, reject) => {
      stop = () => reject(signal.reason);
      signal?.addEventListener("abort", stop, { once: true });
    });
    try {
      await Promise.race([batch.done, aborted]);
    } finally {
      signal?.removeEventListener("abort", stop);
      batch.waiting -= 1;
      if (batch.waiting === 0) batch.control.abort();
    }
    // (One of the waiting queries accounts for it.)
    return batch.came.splice(0).reduce((sum, bytes) => ({ requests: sum.requests + 1, bytes: sum.bytes + bytes }), { requests: 0, bytes: 0 });
  }

  /** Collects ranges for a batch, which starts when the one before has ended. */
  #gather() {
    const batch = { ranges: [], waiting: 0, control: new AbortController(), came: [] };
    const { signal } = batch.control;
    batch.done = this.#before.then(async () => {
      // (Pending queries run first, so that the initial ranges of several queries form one batch.)
      for (let [gathered, time] = [0, 0]; gathered < batch.ranges.length && time < MAX_TURNS; time += 1) {
        gathered = batch.ranges.length;
        await turn();
      }
      this.#next = undefined;
      const isMostRead = this.length <= MODERATE && 2 * this.#came > this.length;
      const isThere = ([start, end]) => batch.since.some(([from, to]) => from <= start && end <= to);
      const left = batch.ranges.filter((range) => !isThere(range));
      const rest = isMostRead && left.length > 0 ? between(this.#fetched, this.length) : [];
      const wanted = join([...left, ...rest]);
      await each(wanted, PARALLEL, async ([start, end]) => {
        signal.throwIfAborted();
        await this.#get(start, end, signal);
        batch.came.push(end - start);
      });
    });
    // A query lists missing ranges when it is tried. Some of these may arrive with an earlier batch
    // before its own starts: each batch has a list of what arrived since it was created, and
    // earlier batches append to the newest list.
    batch.since = this.#since = [];
    this.#before = batch.done.catch(() => {});
    return batch;
  }

  async #get(start, end, signal) {
    const part = await this.read(start, end, signal);
    if (part.length !== end - start) {
      throw new SpinneyError({ code: "changed", message: `${this.name}: got ${part.length} bytes, expected ${end - start}: the file was truncated; open it again`, file: this.name });
    }
    this.#came += part.length;
    this.#since.push([start, end]);
    this.supply(start, part);
  }

  /**
   * The end of read-ahead after an offset, at most `most`: the start of a range that was fetched
   * before.
   */
  aheadOf(place, most) {
    if (this.#fetched.some(([start, end]) => start <= place && place < end)) return place;
    return Math.min(most, this.length, ...this.#fetched.map(([start]) => start).filter((start) => start > place));
  }

  close() {
    if (this.file !== undefined && this.instance === engine.instance()) engine.removeFile(this.file);
    this.file = undefined;
  }

  changed(what) {
    return new SpinneyError({
      code: "changed",
      message: `${this.name}: ${what} while it was read; open it again, or call refresh()`,
      file: this.name,
      found: what,
      advice: "open it again, or call refresh()",
    });
  }
}

/** Bytes in memory. */
class MemorySource extends Source {
  constructor(bytes, name) {
    super(name);
    this.bytes = bytes;
  }

  async start() {
    this.addWhole(this.bytes);
  }

  async resume() {
    await this.start();
  }

  async read(start, end) {
    return this.bytes.subarray(start, end);
  }

  async hasChanged() {
    return false;
  }
}

/** A Blob, or a File that a user has selected. */
class BlobSource extends Source {
  constructor(blob) {
    super(blob.name || "(blob)");
    this.blob = blob;
  }

  async start() {
    this.add(this.blob.size);
  }

  async read(start, end) {
    try {
      return new Uint8Array(await this.blob.slice(start, end).arrayBuffer());
    } catch (error) {
      if (error?.name === "NotReadableError" || error?.name === "NotFoundError") throw this.changed("was changed or removed");
      throw new SpinneyError({ code: "io", message: `${this.name}: cannot read: ${error?.message ?? error}`, file: this.name }, { cause: error });
    }
  }

  async hasChanged() {
    return false;
  }
}

/** Ranges that a caller's object reads: `{ name, size, read(start, end, signal) }`. */
class ReaderSource extends Source {
  constructor(reader) {
    super(String(reader.name ?? "(reader)"));
    this.reader = reader;
  }

  async start() {
    this.add(Number(this.reader.size));
  }

  async read(start, end, signal) {
    try {
      return await this.reader.read(start, end, signal);
    } catch (error) {
      signal?.throwIfAborted();
      throw new SpinneyError({ code: "io", message: `${this.name}: cannot read: ${error?.message ?? error}`, file: this.name }, { cause: error });
    }
  }

  async hasChanged() {
    return false;
  }
}

/** Closes the files of datasets that were garbage-collected without being closed. */
const forgotten = new FinalizationRegistry((handle) => handle.close().catch(() => {}));

/** A local file, under Node. */
class DiskSource extends Source {
  constructor(path) {
    super(path);
    this.path = path;
  }

  async start() {
    this.files = (await import(/* webpackIgnore: true */ /* @vite-ignore */ "node:fs")).promises;
    try {
      this.handle = await this.files.open(this.path, "r");
      this.stamp = await this.stat();
    } catch (error) {
      await this.handle?.close();
      throw new SpinneyError({ code: "io", message: `${this.name}: cannot open: ${error.message}`, file: this.name }, { cause: error });
    }
    if (!this.stamp.isFile) {
      await this.handle.close();
      throw new SpinneyError({ code: "io", message: `${this.name}: cannot open: it is not a regular file`, file: this.name });
    }
    forgotten.register(this, this.handle, this);
    this.add(this.stamp.size);
  }

  async stat() {
    const found = await this.handle.stat({ bigint: true });
    return { size: Number(found.size), modified: found.mtimeNs, isFile: found.isFile() };
  }

  async fetch(ranges, signal) {
    const found = await super.fetch(ranges, signal);
    // (After the reads, so that they are verified to be of the opened version.)
    const now = await this.stat();
    if (now.size > this.stamp.size && this.grows) return found;
    if (now.size !== this.stamp.size) throw this.changed(now.size < this.stamp.size ? "was truncated" : "has grown");
    if (now.modified !== this.stamp.modified) throw this.changed("was overwritten");
    return found;
  }

  async read(start, end) {
    const bytes = new Uint8Array(end - start);
    let filled = 0;
    while (filled < bytes.length) {
      const { bytesRead } = await this.handle.read(bytes, filled, bytes.length - filled, start + filled);
      if (bytesRead === 0) break;
      filled += bytesRead;
    }
    return bytes.subarray(0, filled);
  }

  async hasChanged() {
    const now = await this.files.stat(this.path, { bigint: true }).catch(() => undefined);
    return !now || Number(now.size) !== this.stamp.size || now.mtimeNs !== this.stamp.modified;
  }

  close() {
    super.close();
    const { handle } = this;
    this.handle = undefined;
    forgotten.unregister(this);
    handle?.close().catch(() => {});
  }
}

/** A file on a server. */
export class HttpSource extends Source {
  constructor(url, headers) {
    super(url);
    this.url = url;
    this.headers = headers;
  }

  /** Requests a range, or the whole file. */
  async request(range, signal) {
    const headers = new Headers(this.headers);
    if (range) headers.set("Range", range);
    for (let time = 0; ; time += 1) {
      let response;
      try {
        // (Cached responses may be of an older version; ranges of two versions do not form a file.)
        response = await fetch(this.url, { headers, signal, cache: "no-store" });
      } catch (error) {
        signal?.throwIfAborted();
        if (time === REPEATS) throw new SpinneyError({ code: "io", message: `${this.name}: cannot be reached: ${error.cause?.message ?? error.message}`, file: this.name }, { cause: error });
      }
      const isBusy = response && (response.status === 429 || response.status >= 500);
      if (response && (!isBusy || time === REPEATS)) return response;
      await response?.body?.cancel().catch(() => {});
      await pause(100 * 4 ** time, signal);
    }
  }

  async start(signal) {
    // (A suffix range needs no length, but other origins require a CORS preflight for it.)
    const isNear = typeof location === "undefined" || new URL(this.url).origin === location.origin;
    const wantsTail = isNear && !new URL(this.url).pathname.endsWith(".autumn");
    const later = new AbortController();
    const tail = wantsTail ? this.request(`bytes=-${LAST}`, any(signal, later.signal)) : undefined;
    tail?.catch(() => {});
    try {
      const response = await this.request(`bytes=0-${FIRST - 1}`, signal);
      this.check(response);
      const isCompressed = Boolean(response.headers.get("content-encoding"));
      const place = contentRange(response) ?? (response.status === 206 ? await this.unseenRange(signal) : undefined);
      if (response.status !== 206 || isCompressed || !place) {
        later.abort();
        await this.whole(response, isCompressed, signal);
        return;
      }
      const first = new Uint8Array(await response.arrayBuffer());
      if (first.length !== place.end - place.start) {
        // The host compresses the response without saying so.
        later.abort();
        await this.whole(undefined, true, signal);
        return;
      }
      this.state = stateOf(response);
      this.add(place.length);
      this.supply(0, first);
      if (tail) await this.startTail(await tail, place.length);
    } catch (error) {
      later.abort();
      throw error;
    }
  }

  /** The first range and the file's length, if the host does not expose them to other origins. */
  async unseenRange(signal) {
    const response = await fetch(this.url, { method: "HEAD", headers: this.headers, signal, cache: "no-store" }).catch(() => undefined);
    signal?.throwIfAborted();
    const length = response?.ok ? Number(response.headers.get("content-length")) : 0;
    return length > 0 ? { start: 0, end: Math.min(FIRST, length), length } : undefined;
  }

  /** Adds the file's tail, if the host supports suffix ranges. */
  async startTail(response, length) {
    const place = contentRange(response);
    if (response.status !== 206 || place?.length !== length) {
      await response.body?.cancel().catch(() => {});
      return;
    }
    const bytes = new Uint8Array(await response.arrayBuffer());
    if (bytes.length === place.end - place.start && this.isSame(response)) this.supply(place.start, bytes);
  }

  /** Reads a whole file whose host does not serve ranges. */
  async whole(response, isCompressed, signal) {
    const why = isCompressed ? "the host compresses it" : "the host does not serve ranges of it";
    let found = response;
    if (!found || found.status === 206) {
      await found?.body?.cancel().catch(() => {});
      found = await this.request(undefined, signal);
      this.check(found);
    }
    const bytes = await this.body(found, why, signal);
    this.warnings.push(`${this.name}: ${why}: all of its ${bytes.length} bytes were read`);
    this.isWhole = true;
    this.addWhole(bytes);
  }

  /** The bytes of a response with the whole file. */
  async body(response, why, signal) {
    const refuse = (bytes) => {
      const advice = "use a host that serves ranges and does not compress the file";
      return new SpinneyError({
        code: "unsupported",
        message: `${this.name}: ${why}, and ${bytes} bytes are too many to read all of it (at most ${MAX_WHOLE}); ${advice}`,
        file: this.name,
        found: why,
        advice,
      });
    };
    const contentLength = Number(response.headers.get("content-length"));
    if (contentLength > MAX_WHOLE) {
      await response.body?.cancel().catch(() => {});
      throw refuse(contentLength);
    }
    const parts = [];
    let length = 0;
    for (const reader = response.body.getReader(); ; ) {
      signal?.throwIfAborted();
      const { done, value } = await reader.read();
      if (done) break;
      length += value.length;
      if (length > MAX_WHOLE) {
        await reader.cancel().catch(() => {});
        throw refuse(`more than ${MAX_WHOLE}`);
      }
      parts.push(value);
    }
    const bytes = new Uint8Array(length);
    let at = 0;
    for (const part of parts) {
      bytes.set(part, at);
      at += part.length;
    }
    return bytes;
  }

  async resume(signal) {
    if (this.isWhole) await this.start(signal);
    else this.add(this.length);
  }

  /** Fails if there is no such file. */
  check(response) {
    if (response.ok) return;
    const why = response.status === 404 ? "there is no such file" : `the host returned ${response.status} ${response.statusText}`;
    throw new SpinneyError({ code: response.status === 404 ? "not-found" : "io", message: `${this.name}: ${why}`, file: this.name });
  }

  /** Whether a response is of the opened version, as far as its headers show. */
  isSame(response) {
    const now = stateOf(response);
    return !Object.keys(now).some((name) => this.state[name] && now[name] && this.state[name] !== now[name]);
  }

  /** Fails if a response is not a range of the opened version. */
  accept(response, place) {
    const hasGrown = this.grows && place?.length > this.length;
    if (response.status === 416 || (place && place.length !== this.length && !hasGrown)) throw this.changed("has another length");
    if (response.status === 404) throw this.changed("was removed");
    this.check(response);
    if (!this.isSame(response) && !hasGrown) throw this.changed("was replaced");
    if (response.status !== 206) {
      throw new SpinneyError({ code: "unsupported", message: `${this.name}: the host stopped serving ranges of it`, file: this.name });
    }
  }

  async read(start, end, signal) {
    for (let time = 0; ; time += 1) {
      const response = await this.request(`bytes=${start}-${end - 1}`, signal);
      try {
        this.accept(response, contentRange(response), end);
      } catch (error) {
        await response.body?.cancel().catch(() => {});
        throw error;
      }
      try {
        const bytes = new Uint8Array(await response.arrayBuffer());
        if (bytes.length === end - start || time === REPEATS) return bytes;
      } catch (error) {
        signal?.throwIfAborted();
        if (time === REPEATS) throw new SpinneyError({ code: "io", message: `${this.name}: the connection broke: ${error.message}`, file: this.name }, { cause: error });
      }
      await pause(100 * 4 ** time, signal);
    }
  }

  async hasChanged(signal) {
    const response = await this.request(`bytes=0-0`, signal);
    await response.body?.cancel().catch(() => {});
    this.check(response);
    if (!this.state) return true;
    const place = contentRange(response);
    return !this.isSame(response) || (place && place.length !== this.length);
  }
}

/** Headers that distinguish versions of a file, if the host exposes them. */
function stateOf(response) {
  const state = {};
  for (const name of ["etag", "last-modified"]) {
    const value = response.headers.get(name);
    if (value) state[name] = value;
  }
  return state;
}

/** The range in a response, and the file's length. */
export function contentRange(response) {
  const found = /^bytes (\d+)-(\d+)\/(\d+)$/.exec(response.headers.get("content-range") ?? "");
  return found ? { start: Number(found[1]), end: Number(found[2]) + 1, length: Number(found[3]) } : undefined;
}

/** A signal that aborts if one of two does. */
function any(first, second) {
  return first ? AbortSignal.any([first, second]) : second;
}

/** Waits for one turn of the event loop. */
const turn = () => new Promise((resolve) => setTimeout(resolve));

function pause(milliseconds, signal) {
  return new Promise((resolve, reject) => {
    const stop = () => {
      clearTimeout(timer);
      reject(signal.reason);
    };
    const timer = setTimeout(() => {
      signal?.removeEventListener("abort", stop);
      resolve();
    }, milliseconds);
    signal?.addEventListener("abort", stop, { once: true });
  });
}

/** The source for a user's argument; it can be opened again. */
export function sourceOf(source, options = {}) {
  const found = meant(source, options);
  found.again = () => sourceOf(source, options);
  return found;
}

function meant(source, { headers }) {
  if (source instanceof ArrayBuffer) return new MemorySource(new Uint8Array(source), "(memory)");
  if (ArrayBuffer.isView(source)) return new MemorySource(new Uint8Array(source.buffer, source.byteOffset, source.byteLength), "(memory)");
  if (typeof Blob !== "undefined" && source instanceof Blob) return new BlobSource(source);
  if (typeof source?.read === "function") return new ReaderSource(source);
  if (typeof source !== "string" && !(source instanceof URL)) {
    throw new TypeError("a source is a URL, a path (under Node), a Blob, an ArrayBuffer, a typed array, or has a method `read`");
  }
  const text = String(source);
  const scheme = /^([a-z][a-z0-9+.-]+):/i.exec(text)?.[1].toLowerCase();
  if (scheme === "http" || scheme === "https" || scheme === "blob" || scheme === "data") return new HttpSource(text, headers);
  if (isNode) {
    return new DiskSource(scheme === "file" ? decodeURIComponent(new URL(text).pathname) : text);
  }
  return new HttpSource(new URL(text, globalThis.location?.href).href, headers);
}
