// Rasters as a map: tiles from the package, values under the cursor, styles, legends, polygons, and
// history.

import { button, choice, element, fail, fill, field, latest, slider, table, text, toggle, working } from "./interface.js";
import { changeSettings, configuredStyle } from "./settings.js";
import { colour, ground, showGraticule } from "./ground.js";
import { TILE, mercator, mercatorTiles, nativePlane, nativeTiles } from "./plane.js";
import { hiddenClasses, showLegend } from "./legend.js";
import { PolygonTool } from "./polygon.js";
import { Shared } from "./shared.js";
import { showHistory } from "./history.js";

/** Names of selectable styles, by the kind of values. */
const STYLES = {
  continuous: ["default", "grey", "viridis", "magma", "inferno", "plasma", "cividis", "turbo", "terrain", "hillshade", "relief", "slope", "aspect", "contours"],
  categorical: ["default"],
  colours: ["default", "rgb"],
};

/** The style as an argument of the package: a name or a document, with hidden classes. */
function styleWith(style, hidden) {
  if (hidden.size === 0) return style === "default" ? undefined : style;
  const own = style.startsWith("{") ? JSON.parse(style) : { draw: "palette" };
  return JSON.stringify({ ...own, hide: [...hidden] });
}

/** Maximum number of concurrent tile requests: those of a screen. */
const TILES_AT_ONCE = 64;

let protocols = 0;

let library;

/** Loads the map library, and starts its workers. */
export function prepare(assetUrl) {
  library ??= import(assetUrl("vendor/maplibre-gl.js")).then((maplibre) => {
    maplibre.setWorkerUrl(assetUrl("vendor/maplibre-gl-worker.js"));
    maplibre.prewarm();
    // (All visible tiles, so that their missing ranges are fetched together.)
    maplibre.setMaxParallelImageRequests(TILES_AT_ONCE);
    return maplibre;
  });
  return library;
}

export async function show({ dataset, place, assetUrl, reopen }) {
  const { header } = dataset;
  const maplibre = await prepare(assetUrl);
  const world = mercatorTiles(header);
  const isWorld = world !== null && place.grid !== "native";
  const plane = isWorld ? mercator : nativePlane(header);
  const grid = isWorld ? world : nativeTiles(header);
  const state = { style: place.style ?? "default", hidden: hiddenClasses(place.hide) };
  const opacity = opacityOf(place.opacity);

  // Tiles are requested by address: `spinney1://3/1/2`.
  const protocol = `spinney${++protocols}`;
  const drawn = new Shared();
  maplibre.addProtocol(protocol, async ({ url }, { signal }) => {
    const [z, x, y] = url.slice(protocol.length + 3).split("?")[0].split("/").map(Number);
    const style = styleWith(state.style, state.hidden);
    const tile = await drawn.share(url, signal, (signal) => dataset.tile({ z, x, y, grid: plane.grid, style, signal, progress: working }));
    working();
    return { data: await createImageBitmap(tile ?? new ImageData(1, 1)) };
  });
  const below = isWorld ? await ground(assetUrl) : { sources: {}, layers: [] };
  // (Another address for another style, so that no tile of the old one is shown.)
  const tiles = () => [`${protocol}://{z}/{x}/{y}?${encodeURIComponent(styleWith(state.style, state.hidden) ?? "")}`];
  const map = new maplibre.Map({
    container: "view",
    style: {
      version: 8,
      sources: {
        ...below.sources,
        raster: { type: "raster", tiles: tiles(), tileSize: TILE, maxzoom: grid.maxZoom, bounds: grid.bounds },
      },
      layers: [
        { id: "sea", type: "background", paint: { "background-color": colour(isWorld ? "--sea" : "--ground") } },
        ...below.layers,
        { id: "raster", type: "raster", source: "raster", paint: { "raster-resampling": "nearest", "raster-fade-duration": 0, "raster-opacity": opacity } },
      ],
    },
    maxZoom: Math.min(grid.maxZoom + 6, 24),
    renderWorldCopies: isWorld,
    // (A file's own plane may be visible as a whole, with a margin.)
    ...(!isWorld && { minZoom: -2, transformConstrain: (center, zoom) => ({ center, zoom: Math.max(zoom, -2) }) }),
    attributionControl: false,
    dragRotate: false,
    pitchWithRotate: false,
  });
  map.touchZoomRotate.disableRotation();
  map.keyboard.disableRotation();
  map.addControl(new maplibre.NavigationControl({ showCompass: false }), "top-right");
  if (isWorld) map.addControl(new maplibre.ScaleControl(), "bottom-left");
  map.getCanvas().setAttribute("aria-label", "Map: move it with the arrow keys, zoom with plus and minus");
  map.on("error", ({ error }) => error?.name !== "AbortError" && fail(error));
  if (place.at) {
    const [zoom, ...rest] = place.at.split("/").map(Number);
    map.jumpTo({ zoom, center: plane.degreesOf(rest) });
  } else {
    map.fitBounds(grid.bounds, { padding: free(), animate: false });
  }
  map.on("moveend", () => {
    const middle = plane.placeOf(map.getCenter());
    changeSettings({ at: [map.getZoom().toFixed(2), ...middle.map((at) => Number(at.toPrecision(10)))].join("/") });
  });
  map.once("idle", () => document.documentElement.setAttribute("data-drawn", ""));
  await new Promise((done) => map.once("load", done));
  if (isWorld) {
    showGraticule(map);
    map.on("moveend", () => showGraticule(map));
  }

  const redraw = () => map.getSource("raster")?.setTiles(tiles());
  const legend = latest(async (signal) => {
    const made = await dataset.legend({ style: styleWith(state.style, new Set()), signal });
    showLegend(made, state.hidden, () => {
      changeSettings({ hide: [...state.hidden].join(",") || undefined });
      redraw();
    });
  });

  const names = STYLES[header.channels >= 3 ? "colours" : header.meaning === "categorical" ? "categorical" : "continuous"];
  const all = [...new Set([configuredStyle(), state.style, ...names])].filter(Boolean);
  all.sort((one, other) => names.indexOf(one) - names.indexOf(other));
  if (all.length > 1) {
    field("Style", choice(all.map((name) => [name, name.startsWith("{") ? "the page's" : name]), state.style, (name) => {
      state.style = name;
      state.hidden.clear();
      changeSettings({ style: name === "default" ? undefined : name, hide: undefined });
      redraw();
      legend();
    }));
  }
  field("Opacity", slider(0, 1, opacity, 0.05, (value) => {
    map.setPaintProperty("raster", "raster-opacity", value);
    changeSettings({ opacity: value === 1 ? undefined : value });
  }));
  if (world !== null) {
    const grids = [["web-mercator", "web mercator"], ["native", "the file's own"]];
    field("Grid", choice(grids, plane.grid, (chosen) => reopen({ grid: chosen === "native" ? chosen : undefined, at: undefined })));
  }
  legend();
  await showHistory({ dataset, map, plane, place, reopen });

  // Values: those under the cursor in the status line, those of a clicked point in the panel.
  const read = (signal, place) => dataset.point(place, { crs: plane.crs, signal, progress: working });
  const line = latest(async (signal, lngLat) => {
    const place = plane.placeOf(lngLat);
    const found = await read(signal, place);
    element("value").textContent = `${plane.text(place)}: ${describe(found, header)}`;
  });
  const showPoint = latest(async (signal, lngLat) => {
    const place = plane.placeOf(lngLat);
    const found = await read(signal, place);
    const name = (at) => header.channelNames[at] || (found.values.length > 1 ? `band ${at + 1}` : "value");
    const rows = found.values === null ? [["value", "none"]] : found.values.map((value, at) => [name(at), text(value)]);
    if (found.className) rows.push(["class", found.className]);
    if (found.cell) rows.push(["cell", found.cell.join(", ")]);
    fill("result", plane.text(place), table([], rows));
  });
  const polygon = new PolygonTool({ map, maplibre, dataset, plane, header });
  map.on("mousemove", ({ lngLat }) => line(lngLat));
  map.on("click", ({ lngLat }) => (polygon.isDrawing ? polygon.add(lngLat) : showPoint(lngLat)));
  map.getCanvas().addEventListener("keydown", (event) => {
    if (event.key === "Enter") polygon.isDrawing ? polygon.add(map.getCenter()) : showPoint(map.getCenter());
  });
  const draw = toggle("Draw a polygon", "Click its vertices (or move the map and press Enter); finish with a double click or Finish", (isOn) => (isOn ? polygon.start() : polygon.stop()));
  polygon.onEnd = () => draw.setAttribute("aria-pressed", "false");
  const row = Object.assign(document.createElement("div"), { className: "row" });
  row.append(draw, button("Finish", "Close the polygon and read its statistics", () => polygon.finish()), button("Clear", "Remove the polygon", () => polygon.clear()));
  fill("tools", "Statistics of a region", row);

  const onTheme = () => {
    map.setPaintProperty("sea", "background-color", colour(isWorld ? "--sea" : "--ground"));
    if (!isWorld) return;
    map.setPaintProperty("graticule", "line-color", colour("--line"));
    map.setPaintProperty("coast", "line-color", colour("--coast"));
  };
  const scheme = matchMedia("(prefers-color-scheme: dark)");
  scheme.addEventListener("change", onTheme);
  return {
    map,
    close() {
      scheme.removeEventListener("change", onTheme);
      polygon.clear();
      maplibre.removeProtocol(protocol);
      map.remove();
      element("view").replaceChildren();
    },
  };
}

/** The opacity of the settings: 1 if they have none, or an invalid one. */
function opacityOf(setting) {
  const opacity = Number(setting ?? 1);
  return opacity >= 0 && opacity <= 1 ? opacity : 1;
}

/** Padding of the visible area, which excludes the panel. */
function free() {
  const { width, height } = element("view").getBoundingClientRect();
  const panel = element("panel").getBoundingClientRect();
  const isBelow = panel.width > width / 2;
  const most = isBelow ? height / 2 : width / 2;
  return { top: 24, right: 24, bottom: isBelow ? Math.min(panel.height + 24, most) : 48, left: isBelow ? 24 : Math.min(panel.right + 24, most) };
}

/** A short description of a value. */
function describe(found, header) {
  if (found.values === null) return "nothing";
  const values = found.values.map(text).join(", ");
  const unit = header.units?.[0] ? ` ${header.units[0]}` : "";
  return found.className ? `${found.className} (${values})` : values + unit;
}
