// Open datasets and models, and their queries.

import * as engine from "./engine.js";
import { SpinneyError } from "./errors.js";
import { image } from "./images.js";
import { IndexedFiles } from "./indexed.js";
import { sourceOf } from "./sources.js";

/** Typed arrays by sample type. */
const ARRAYS = {
  u8: Uint8Array,
  i8: Int8Array,
  u16: Uint16Array,
  i16: Int16Array,
  u32: Uint32Array,
  i32: Int32Array,
  u64: BigUint64Array,
  i64: BigInt64Array,
  f32: Float32Array,
  f64: Float64Array,
};

/** Maximum attempts of a query whose module instance was ended by other queries. */
const TRIES = 4;

/** A file that several datasets read. */
class Shared {
  constructor(source) {
    this.source = source;
    this.files = new IndexedFiles(source);
    this.users = 0;
    this.resuming = undefined;
  }

  /** Ensures that the module's instance has the file. */
  async ready(signal) {
    if (this.source.instance === engine.instance()) return;
    this.resuming ??= this.source.resume(signal).finally(() => {
      this.resuming = undefined;
    });
    await this.resuming;
  }

  leave() {
    this.users -= 1;
    if (this.users === 0) this.files.close();
  }
}

/** An open tree or model, with its file. */
class Opened {
  #shared;
  #place;
  #number;
  #instance = -1;
  #isClosed = false;

  constructor(shared, place, { opened, header }) {
    this.#shared = shared;
    this.#place = place;
    this.#number = opened;
    this.#instance = engine.instance();
    shared.users += 1;
    this.header = header;
  }

  /** Remarks on the file and its host. */
  get warnings() {
    return [...this.#shared.source.warnings, ...(this.header.remark ? [this.header.remark] : [])];
  }

  /** Runs a query in the module. */
  async query(query, request, { signal, progress, coordinates, buffers } = {}) {
    return attempts(async () => {
      if (this.#isClosed) throw new SpinneyError({ code: "invalid", message: `${this.#shared.source.name}: the dataset is closed` });
      signal?.throwIfAborted();
      await this.#shared.ready(signal);
      if (this.#instance !== engine.instance()) {
        const { json } = await openIn(this.#shared, this.#place, { signal });
        [this.#number, this.#instance] = [json.opened, engine.instance()];
      }
      return engine.query(this.#shared.files, { ...plain(request), query, of: this.#number }, { coordinates, signal, progress, buffers });
    });
  }

  /** Opens another layer or commit of the same file. */
  async other(place, { signal, progress } = {}) {
    if (this.#isClosed) throw new SpinneyError({ code: "invalid", message: `${this.#shared.source.name}: the dataset is closed` });
    return openShared(this.#shared, { ...this.#place, ...place }, { signal, progress });
  }

  /** Returns whether the file has changed; if so, it is opened again. */
  async refresh({ signal, progress } = {}) {
    const old = this.#shared;
    if (!(await old.source.hasChanged(signal))) return false;
    const shared = new Shared(old.source.again());
    await shared.source.start(signal);
    let json;
    try {
      ({ json } = await attempts(() => openIn(shared, this.#place, { signal, progress })));
    } catch (error) {
      shared.files.close();
      throw error;
    }
    shared.source.grows = json.header.format === "autumnal";
    this.#release();
    [this.#shared, this.#number, this.#instance] = [shared, json.opened, engine.instance()];
    shared.users += 1;
    old.leave();
    this.header = json.header;
    return true;
  }

  #release() {
    if (this.#instance === engine.instance()) engine.close(this.#number);
  }

  /** Releases the memory. */
  close() {
    if (this.#isClosed) return;
    this.#isClosed = true;
    this.#release();
    this.#shared.leave();
  }
}

/** A request without the query options. */
function plain({ signal, progress, ...request } = {}) {
  return request;
}

/** Repeats work if another query has ended the module meanwhile. */
async function attempts(work) {
  for (let time = 1; ; time += 1) {
    try {
      return await work();
    } catch (error) {
      if (!(error instanceof engine.Replaced)) throw error;
      if (time === TRIES) throw new SpinneyError({ code: "panic", message: "the module was replaced repeatedly while the query ran; run the query again" });
    }
  }
}

async function openIn(shared, { commit, layer }, { signal, progress } = {}) {
  await shared.ready(signal);
  return engine.query(shared.files, { query: "open", file: shared.source.file, commit, layer }, { signal, progress });
}

async function openShared(shared, place, options) {
  const { json } = await attempts(() => openIn(shared, place, options));
  shared.source.grows = json.header.format === "autumnal";
  return json.header.kind === "model" ? new Model(shared, place, json) : new Dataset(shared, place, json);
}

/** Opens a file. */
export async function open(source, { signal, progress, headers, cacheBytes, layer, commit } = {}) {
  await engine.load();
  signal?.throwIfAborted();
  if (cacheBytes !== undefined) engine.setCacheBytes(cacheBytes);
  const place = { commit: commit === undefined ? undefined : Number(commit), layer: layer === undefined ? undefined : String(layer) };
  for (let time = 1; ; time += 1) {
    const shared = new Shared(sourceOf(source, { headers }));
    try {
      await shared.source.start(signal);
      return await openShared(shared, place, { signal, progress });
    } catch (error) {
      shared.files.close();
      // (A file that is being written is read again.)
      if (error?.code !== "changed" || time === TRIES) throw error;
    }
  }
}

/** Coordinates, concatenated. */
function flat(positions, axes) {
  const numbers = new Float64Array(positions.length * axes);
  positions.forEach((position, index) => {
    if (position.length < axes) throw new SpinneyError({ code: "invalid", message: `point ${index}: got ${position.length} coordinates, expected ${axes}` });
    for (let axis = 0; axis < axes; axis += 1) numbers[index * axes + axis] = Number(position[axis]);
  });
  return numbers;
}

/** Samples of a window, as a typed array. */
function samples({ json, buffers }) {
  const { hasMask, ...found } = json;
  const [bytes, mask] = buffers;
  const data = new ARRAYS[found.sampleType](bytes.buffer, bytes.byteOffset, bytes.byteLength / ARRAYS[found.sampleType].BYTES_PER_ELEMENT);
  return { ...found, data, mask: hasMask ? mask : undefined };
}

/** A style, as a string: its name, or its document. */
function styleText(style) {
  return style === undefined || typeof style === "string" ? style : JSON.stringify(style);
}

/** GeoJSON, as a string. */
function geoJson(zones) {
  return typeof zones === "string" ? zones : JSON.stringify(zones);
}

/** A file of cells: a raster, or a volume. */
export class Dataset extends Opened {
  async window(request = {}) {
    return samples(await this.query("window", request, { ...request, buffers: 2 }));
  }

  async point(position, options = {}) {
    return (await this.points([position], options))[0];
  }

  async points(positions, options = {}) {
    const numbers = flat(positions, this.header.dimension);
    return (await this.query("points", options, { ...options, coordinates: numbers })).json;
  }

  async stats({ geometry, ...request } = {}) {
    if (geometry === undefined) return (await this.query("stats", request, request)).json;
    const { zones } = await this.zonal(geometry, request);
    return zones[0];
  }

  async zonal(zones, request = {}) {
    return (await this.query("zonal", { ...request, zones: geoJson(zones) }, request)).json;
  }

  async histogram(request = {}) {
    return (await this.query("histogram", request, request)).json;
  }

  async find({ where, ...request } = {}) {
    return (await this.query("find", { ...request, ...where }, request)).json;
  }

  async image({ style, ...request } = {}) {
    const { json, buffers } = await this.query("image", { ...request, style: styleText(style) }, { ...request, buffers: 1 });
    return image(buffers[0], json.width, json.height, json);
  }

  async tile({ style, ...request }) {
    const { json, buffers } = await this.query("tile", { ...request, style: styleText(style) }, { ...request, buffers: 1 });
    return json.isEmpty ? null : image(buffers[0], json.side, json.side);
  }

  async legend({ style, ...request } = {}) {
    return (await this.query("legend", { style: styleText(style) }, request)).json;
  }

  async openLayer(layer, options = {}) {
    return this.other({ layer: String(layer) }, options);
  }

  async openCommit(commit, options = {}) {
    return this.other({ commit: Number(commit) }, options);
  }

  async commits(options = {}) {
    return (await this.query("commits", options, options)).json;
  }

  async diff(from, to, options = {}) {
    return (await this.query("diff", { ...options, from: Number(from), to: to === undefined ? undefined : Number(to) }, options)).json;
  }

  async slice({ style, ...request }) {
    if (style !== undefined) {
      const { json, buffers } = await this.query("slice", { ...request, style: styleText(style) }, { ...request, buffers: 1 });
      return image(buffers[0], json.width, json.height, json);
    }
    return samples(await this.query("slice", request, { ...request, buffers: 2 }));
  }

  async geographic(positions, options = {}) {
    return (await this.query("geographic", options, { ...options, coordinates: flat(positions, 2) })).json;
  }

  async mesh(request = {}) {
    const { json, buffers } = await this.query("mesh", request, { ...request, buffers: 2 });
    return { ...json, positions: new Float32Array(buffers[0].buffer), indices: new Uint32Array(buffers[1].buffer) };
  }

  async contains(position, options = {}) {
    return (await this.query("contains", options, { ...options, coordinates: flat([position], 3) })).json[0];
  }
}

/** An exact model. */
export class Model extends Opened {
  async measures(options = {}) {
    return (await this.query("measures", options, options)).json;
  }

  async locate(position, options = {}) {
    return (await this.query("contains", options, { ...options, coordinates: flat([position], 3) })).json[0];
  }

  async contains(position, options = {}) {
    return (await this.locate(position, options)) !== "outside";
  }

  async section(request) {
    return (await this.query("section", request, request)).json;
  }

  async cut(request) {
    return (await this.query("cut", request, request)).json;
  }

  async triangles(options = {}) {
    const { json, buffers } = await this.query("triangles", options, { ...options, buffers: 2 });
    return { ...json, positions: new Float32Array(buffers[0].buffer), objects: new Uint32Array(buffers[1].buffer) };
  }

  async mesh(request = {}) {
    const { json, buffers } = await this.query("mesh", request, { ...request, buffers: 4 });
    const { hasColours, ...rest } = json;
    const [indices, objects] = [buffers[1], buffers[2]].map(({ buffer }) => new Uint32Array(buffer));
    return { ...rest, positions: new Float32Array(buffers[0].buffer), indices, objects, colours: hasColours ? buffers[3] : null };
  }
}
