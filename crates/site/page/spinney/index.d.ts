// Types of the package `spinney`.

/**
 * A file: a URL, a path (under Node), a file that a user has selected, its bytes, or an object that
 * reads it.
 */
export type Source = string | URL | Blob | ArrayBuffer | Uint8Array | Reader;

/** An object that reads ranges of a file: bytes from `start` to before `end`. */
export interface Reader {
  name: string;
  size: number;
  read(start: number, end: number, signal?: AbortSignal): Promise<Uint8Array>;
}

/** Work of a query so far: batches, requests, and bytes received. */
export interface Traffic {
  batches: number;
  requests: number;
  bytes: number;
}

/** Options of queries. */
export interface QueryOptions {
  /** Aborts the query, between two batches or during one. */
  signal?: AbortSignal;
  /** Called after each batch. */
  progress?: (traffic: Traffic) => void;
}

export interface OpenOptions extends QueryOptions {
  /** Headers of requests, for example with a token. */
  headers?: HeadersInit;
  /** Size in bytes of the cache for remote files, shared by all of them; default 64 MiB. */
  cacheBytes?: number;
  /** The layer, by name or number; default the first. */
  layer?: string | number;
  /** The commit of an `.autumn` file; default the newest. */
  commit?: number;
}

export type SampleType = "u8" | "i8" | "u16" | "i16" | "u32" | "i32" | "u64" | "i64" | "f32" | "f64";
export type Samples =
  | Uint8Array | Int8Array | Uint16Array | Int16Array | Uint32Array | Int32Array
  | BigUint64Array | BigInt64Array | Float32Array | Float64Array;
/** A sample; a BigInt for 64-bit types. */
export type Sample = number | bigint;
/** A number of cells; a BigInt if it is larger than 2^53. */
export type Count = number | bigint;
export type Colour = [red: number, green: number, blue: number, alpha: number];

export interface Class {
  value: Sample;
  name: string | null;
  colour: Colour | null;
}

export interface CrsInfo {
  name: string | null;
  /** Number in the EPSG registry, if it has one. */
  epsg: number | null;
  /** The unchanged definition. */
  definition: string;
}

export interface Commit {
  number: number;
  /** Seconds since 1970. */
  time: number | null;
  author: string;
  message: string;
  cells: Count;
  records: Count;
  written_records: number;
  written_bytes: number;
  shared_records: number;
  spared_bytes: number;
}

export interface LayerInfo {
  name: string;
  sampleType: SampleType;
  channels: number;
  meaning: string;
  size: Count[];
  levels: number;
}

/** The content of a file of cells. */
export interface Header {
  kind: "raster" | "volume";
  format: "goblin" | "autumnal";
  codec: "plain" | "packed" | "reference";
  dimension: 2 | 3;
  /** Cells along x and y, in volumes also z. */
  size: number[];
  /** The deepest level, whose cells are the file's. */
  depth: number;
  /** Number of levels; level 0 is a single cell. */
  levels: number;
  sampleType: SampleType;
  channels: number;
  /** Meaning of the values: "categorical", "continuous", ... */
  meaning: string;
  /** The rule that computes values of coarser levels. */
  rule: string;
  noData: Sample | null;
  crs: CrsInfo | null;
  unit: string | null;
  /** Minimum and maximum coordinates, in the file's own system. */
  bounds: number[];
  /** West, south, east and north in degrees, if known. */
  geographicBounds: [number, number, number, number] | null;
  /**
   * Order differs from GDAL's: x = a column + b row + c, y = d column + e row + f. Only for
   * rasters.
   */
  transform: [number, number, number, number, number, number] | null;
  matrix: number[][];
  channelNames: string[];
  scaleOffset: [factor: number, summand: number][];
  units: string[];
  classes: Class[];
  tags: Record<string, string>;
  provenance: string[];
  /** The open layer, and its number. */
  layer: string;
  layerNumber: number;
  time: string | null;
  layers: LayerInfo[];
  commit: Commit | null;
  /** Size of the file in bytes. */
  bytes: number;
  remark: string | null;
}

/** A level of detail of an exact model: a closed surface. */
export interface DetailLevel {
  faces: Count;
  /** Bound of the distance between the level and the exact surface, both ways. */
  error: number;
  /** Bytes of the faces that are stored for this level. */
  bytes: Count;
  /** Connected surfaces of an object that have no faces in this level. */
  vanishedBodies: Count;
  /** Bound of the largest diameter of these. */
  vanishedDiameter: number;
}

/** The content of a file of an exact model. */
export interface ModelHeader {
  kind: "model";
  format: "goblin";
  codec: "plain" | "packed";
  dimension: 3;
  faces: Count;
  depth: number;
  bounds: number[] | null;
  crs: CrsInfo | null;
  unit: string | null;
  /** Names of the objects. */
  objects: string[];
  /** Levels of detail, coarsest first; the last is the exact surface. Empty if there are none. */
  levels: DetailLevel[];
  tags: Record<string, string>;
  provenance: string[];
  bytes: number;
}

/**
 * A region: cells of the deepest level (first ones, and exclusive ends), or minimum and maximum
 * coordinates. The default is everything.
 */
export interface Region {
  cells?: number[];
  bounds?: number[];
  /**
   * The coordinates of `bounds`: "world" (the file's own, the default), "lonlat", "EPSG:NUMBER", or
   * another definition.
   */
  crs?: string;
}

/**
 * A level, or a number of cells along the longer axis: the coarsest level that has at least as
 * many. The default is the deepest level.
 */
export interface Detail {
  level?: number;
  size?: number;
}

export interface WindowRequest extends Region, Detail, QueryOptions {
  /** Selected channels, from 0; default all. */
  channels?: number[];
  /** The number for cells without a value: by default `noData`, or 0, or NaN. */
  fill?: number;
}

export interface Window {
  /** Columns, rows, and (in volumes) planes. */
  width: number;
  height: number;
  layers: number;
  channels: number;
  sampleType: SampleType;
  /** Samples, row by row; those of a cell are contiguous. */
  data: Samples;
  /** 1 for each cell that has a value, 0 for those that have none. Missing if all have one. */
  mask?: Uint8Array;
  level: number;
  /** Covered cells of the deepest level: first ones, and exclusive ends. */
  cells: number[];
  /** Their minimum and maximum coordinates. */
  bounds: number[];
}

export interface PointValue {
  /** The first channel's sample; null without a value. */
  value: Sample | null;
  values: Sample[] | null;
  className: string | null;
  cell: number[] | null;
  level: number;
  /** Whether the position is outside of the raster. */
  isOutside: boolean;
}

export interface ClassCount {
  value: Sample;
  name: string | null;
  cells: Count;
  /** Only for rasters. */
  area_m2?: number | null;
  /** Only for volumes, in cubic world units. */
  volume?: number | null;
}

export interface Bin {
  from: number;
  cells: Count;
}

/** Statistics as `spinney stats --json` prints them. */
export interface Statistics {
  layer: string;
  cells: Count;
  void_cells: Count;
  void_share: number | null;
  /** Only for rasters. */
  area_m2?: number | null;
  /** Only for volumes, in the cube of `unit`, the world unit. */
  volume?: number | null;
  unit?: string | null;
  channels: { cells: Count; min: Sample; max: Sample; mean: number; standard_deviation: number }[];
  classes: ClassCount[];
  histogram: Bin[];
  segments_read: number;
}

export interface ZoneChannel {
  cells: number;
  min: Sample | null;
  max: Sample | null;
  sum: number;
  mean: number | null;
  standard_deviation: number | null;
  majority?: Sample;
  minority?: Sample;
  variety?: number;
  median?: number;
  quantiles?: Record<string, number>;
}

export interface ZoneStatistics {
  cells: number;
  void_cells: number;
  void_share: number | null;
  outside_cells: number;
  /** Only for rasters. */
  area_m2?: number | null;
  /** Only for volumes, in the cube of `unit`, the world unit. */
  volume?: number | null;
  unit?: string | null;
  channels: ZoneChannel[];
  classes: { value: Sample; name: string | null; cells: number; area_m2?: number | null; volume?: number | null }[];
}

export interface Zone extends Partial<ZoneStatistics> {
  id: unknown;
  name: string | null;
  properties: Record<string, unknown>;
  /** Statistics per layer, if several were requested. */
  layers?: (ZoneStatistics & { layer: string; time: string | null })[];
}

export interface ZonalRequest extends QueryOptions {
  /**
   * Coordinates of the vertices, if they are not those of the GeoJSON: longitude and latitude, or
   * its member `crs`.
   */
  crs?: string;
  /**
   * Which cells at an edge count: each by its share inside ("area", the default), those whose
   * centre is inside, or all that touch.
   */
  edge?: "area" | "centre" | "touch";
  /** Measures that read all values: "majority", "minority", "variety", "median". */
  measures?: string[];
  /** Quantiles from 0 to 1. */
  quantiles?: number[];
  /** Requested layers. */
  layers?: string[];
}

export interface FoundBlock {
  code: string;
  level: number;
  min: Count[];
  size: Count[];
  world: [number[], number[]];
  /** Missing (null) if the block has several values. */
  value: Sample | null;
}

export interface FindRequest extends Region, QueryOptions {
  where: { above: number } | { below: number } | { equal: number };
  /** Maximum number of blocks; default 10,000. */
  limit?: number;
  /** The largest blocks, instead of the first. */
  largest?: number;
}

export interface Difference {
  from: number;
  to: number;
  added: Count;
  removed: Count;
  changed: Count;
  /** The sum of all three. */
  changedCells: Count;
  blockCount: Count;
  /** Differing blocks that are uniform in both commits, up to the requested number. */
  blocks: { min: number[]; size: number[]; world: [number[], number[]]; before: Sample | null; after: Sample | null }[];
}

export interface SliceRequest extends Region, Detail, QueryOptions {
  axis: "x" | "y" | "z";
  /** The coordinate along the axis, in the file's system, or the cell of the deepest level. */
  at?: number;
  index?: number;
}

export interface MeshRequest extends Region, QueryOptions {
  level?: number;
  /** The smooth surface, instead of the cells' faces. */
  smooth?: boolean;
}

export interface Mesh {
  /** The origin, which must be added to all positions. */
  origin: [number, number, number];
  positions: Float32Array;
  indices: Uint32Array;
  level: number;
}

/** A viewpoint, and how fine the surface must be that is seen from it. */
export interface CutRequest extends QueryOptions {
  /** Position of the eye. */
  eye: [number, number, number];
  /** Maximum error of the surface per distance from the eye, such as the angle of a pixel. */
  tolerance: number;
  /**
   * What is seen: the points with `a x + b y + c z + d >= 0` for all `[a, b, c, d]`. The rest of
   * the surface is coarse. By default, everything is seen.
   */
  halfSpaces?: [number, number, number, number][];
  /** Maximum number of faces: the tolerance is increased until there are no more. */
  faces?: number;
}

/** A surface for a viewpoint. */
export interface Cut {
  /** Numbers of the clusters of faces that it consists of. */
  clusters: number[];
  /** Number of its faces. */
  faces: Count;
  /** Bound of the distance from the exact surface, both ways. */
  error: number;
}

/** The detail of a model's surface: at most one of `error`, `faces`, `level` and `clusters`. */
export interface SurfaceRequest extends QueryOptions {
  /** As few faces as possible, whose distance from the exact surface is at most this. */
  error?: number;
  /** The smallest error for which there are at most this many faces. */
  faces?: number;
  /** Index into `levels` of the header. */
  level?: number;
  /** Numbers of clusters, as `cut` returns them; without `bounds`. */
  clusters?: number[];
  /**
   * Minimum and maximum coordinates: only faces of the exact surface, or clusters of another one,
   * that touch this box.
   */
  bounds?: number[];
}

/** A surface of triangles of an exact model. */
export interface Surface {
  /** The origin, which must be added to all positions. */
  origin: [number, number, number];
  triangles: number;
  /** Names of the objects. */
  names: string[];
  /** Bound of the distance from the exact surface, both ways; 0 if it is exact. */
  error: number;
  positions: Float32Array;
  indices: Uint32Array;
  /** Object number of each triangle (index into `names`). */
  objects: Uint32Array;
  /** Red, green and blue of the three corners of each triangle, if all faces have colours. */
  colours: Uint8Array | null;
  /**
   * The requested clusters, if any, by ascending numbers: the triangles of each are those from the
   * end of the previous one to its own. Clusters share no vertices.
   */
  clusters: { number: number; end: number }[] | null;
}

/**
 * A style: its name ("viridis", "terrain", "hillshade", ...), or its document (docs/styles.md of
 * the project).
 */
export type Style = string | object;

/** Used without `ImageData`, as under Node. */
export interface Pixels {
  width: number;
  height: number;
  data: Uint8ClampedArray;
}

/** Pixels with their level and bounds. */
export type RegionImage = (ImageData | Pixels) & { level: number; cells: number[]; bounds: number[] };

export interface Legend {
  title: string;
  sections: {
    title: string;
    /** `value` is null if a colour is not that of a class. */
    classes?: { value: number | null; label: string; colour: Colour }[];
    ramp?: { stops: Colour[]; ticks: { at: number; label: string }[] };
  }[];
}

interface Opened<H> {
  readonly header: H;
  /** Remarks on the file and its host: that it was read whole, for example. */
  readonly warnings: string[];
  /**
   * Opens the file again if it has changed, for example if there are new commits; returns whether
   * it has.
   */
  refresh(options?: QueryOptions): Promise<boolean>;
  /** Releases the memory. */
  close(): void;
}

/** A raster, or a volume. */
export interface Dataset extends Opened<Header> {
  window(request?: WindowRequest): Promise<Window>;
  point(position: ArrayLike<number>, options?: { crs?: string; level?: number } & QueryOptions): Promise<PointValue>;
  points(positions: ArrayLike<number>[], options?: { crs?: string; level?: number } & QueryOptions): Promise<PointValue[]>;
  /** Exact statistics of a region. */
  stats(request?: Region & { bins?: number } & QueryOptions): Promise<Statistics>;
  /** Exact statistics of a polygon; each cell counts by its share inside. */
  stats(request: { geometry: object | string } & ZonalRequest): Promise<Zone>;
  /** Exact statistics of each polygon of a GeoJSON. */
  zonal(zones: object | string, request?: ZonalRequest): Promise<{ zones: Zone[] }>;
  histogram(request?: Region & { bins?: number; low?: number; high?: number } & QueryOptions): Promise<{ low: number | null; high: number | null; bins: Bin[] }>;
  /** Blocks whose cells all meet a condition on the first channel. */
  find(request: FindRequest): Promise<{ blocks: FoundBlock[]; isAll: boolean }>;
  /** An image of a region in a style. Its pixels are the cells of the level. */
  image(request?: Region & Detail & { style?: Style } & QueryOptions): Promise<RegionImage>;
  /** A tile of web maps, or of the file's own square; null if it is empty. */
  tile(request: { x: number; y: number; z: number; grid?: "web-mercator" | "native"; size?: number; style?: Style } & QueryOptions): Promise<ImageData | Pixels | null>;
  /** Meaning of the colours of a style. */
  legend(request?: { style?: Style } & QueryOptions): Promise<Legend>;
  openLayer(layer: string | number, options?: QueryOptions): Promise<Dataset>;
  openCommit(commit: number, options?: QueryOptions): Promise<Dataset>;
  /** The commits of an `.autumn` file, newest first. */
  commits(options?: { limit?: number } & QueryOptions): Promise<Commit[]>;
  diff(from: number, to?: number, options?: Region & { limit?: number } & QueryOptions): Promise<Difference>;
  /** A slice of a volume: columns and rows are the other two axes, in their order. */
  slice(request: SliceRequest): Promise<Window>;
  /** Its colours in a style; a vertical slice has the highest cells at the top. */
  slice(request: SliceRequest & { style: Style }): Promise<RegionImage>;
  /** Longitudes and latitudes of positions in the file's own system; null if there are none. */
  geographic(positions: ArrayLike<number>[], options?: QueryOptions): Promise<([number, number] | null)[]>;
  /** The surface of a volume's level as triangles. */
  mesh(request?: MeshRequest): Promise<Mesh>;
  /** Whether a position is in the solid. */
  contains(position: ArrayLike<number>, options?: { level?: number } & QueryOptions): Promise<boolean>;
}

export interface Measures {
  unit: string | null;
  volume: number;
  surface: number;
  faces: Count;
  centre: [number, number, number] | null;
  second_moments: number[][];
  inertia: number[][];
  bounds: [number[], number[]] | null;
}

export interface Section {
  type: "FeatureCollection";
  area: number;
  /** Two unit vectors in the plane. */
  axes: [[number, number, number], [number, number, number]];
  features: { type: "Feature"; properties: { area: number }; geometry: { type: "Polygon"; coordinates: [number, number, number][][] } }[];
}

/** An exact model. */
export interface Model extends Opened<ModelHeader> {
  measures(options?: QueryOptions): Promise<Measures>;
  /** Whether a position is in the body or on its surface. */
  contains(position: ArrayLike<number>, options?: QueryOptions): Promise<boolean>;
  locate(position: ArrayLike<number>, options?: QueryOptions): Promise<"inside" | "outside" | "boundary">;
  /**
   * The section of the model by a plane: across an axis at a coordinate, or the points whose
   * product with a normal is `at`.
   */
  section(request: ({ axis: "x" | "y" | "z" } | { normal: [number, number, number] }) & { at: number } & QueryOptions): Promise<Section>;
  /**
   * Chooses a closed surface that is fine where the eye is near, in a file with levels. `mesh`
   * returns the triangles of its clusters: of those that a previous surface did not have.
   */
  cut(request: CutRequest): Promise<Cut>;
  /**
   * All faces as triangles: nine numbers each, relative to an origin, and the object number of each
   * (index into `names`).
   */
  triangles(options?: QueryOptions): Promise<{ origin: [number, number, number]; triangles: number; names: string[]; positions: Float32Array; objects: Uint32Array }>;
  /**
   * The surface as triangles, at a level of detail; by default, the exact one. A detail needs a
   * file with levels. Coarse surfaces are for display: they are closed where the exact one
   * is, but may intersect themselves, within their error.
   */
  mesh(request?: SurfaceRequest): Promise<Surface>;
}

/**
 * Classes of results of `open`, for `instanceof`. (Results of `openInWorker` have the same methods;
 * `header.kind` distinguishes the two in all cases.)
 */
export const Dataset: abstract new (...list: never[]) => Dataset;
export const Model: abstract new (...list: never[]) => Model;

/** Opens a file in this thread: under Node, or in a worker. */
export function open(source: Source, options?: OpenOptions): Promise<Dataset | Model>;
/** Opens a file in a worker; the first call starts it. Results are transferred, not copied. */
export function openInWorker(source: Source, options?: OpenOptions): Promise<Dataset | Model>;
/** Source of the module: a URL, its bytes, a response, or a compiled module. */
export type ModuleSource = string | URL | BufferSource | Response | WebAssembly.Module;
/** Sets the source of the module. Must be called before the first file is opened. */
export function setModule(source: ModuleSource | Promise<ModuleSource>): void;
/** Sets how the worker of `openInWorker` is started. */
export function setWorker(start: () => Worker): void;

/** A failure: its kind, the file, what was found there, what was expected, and advice. */
export class SpinneyError extends Error {
  readonly code:
    | "corrupt" | "unsupported" | "no-tree" | "invalid" | "io" | "not-found" | "changed" | "too-large" | "no-body" | "panic" | "other";
  readonly file?: string;
  readonly place?: string;
  readonly found?: string;
  readonly expected?: string;
  readonly advice?: string;
}
/** The module ended unexpectedly. It has been replaced: the next query works. */
export class PanicError extends SpinneyError {}
