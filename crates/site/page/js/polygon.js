// A polygon drawn on the map, and the exact statistics of its cells.

import { colour } from "./ground.js";
import { clearResult, element, fill, latest, paragraph, table, text, working } from "./interface.js";

const NOTHING = { type: "FeatureCollection", features: [] };

export class PolygonTool {
  /** Whether clicks add vertices. */
  isDrawing = false;
  /** Called when drawing ends. */
  onEnd = () => {};
  #corners = [];
  /** Heading of the statistics that were shown last. */
  #heading;

  constructor({ map, maplibre, dataset, plane, header }) {
    Object.assign(this, { map, dataset, plane, header });
    map.addSource("polygon", { type: "geojson", data: NOTHING });
    map.addLayer({ id: "polygon", type: "fill", source: "polygon", paint: { "fill-color": colour("--accent"), "fill-opacity": 0.15 } });
    map.addLayer({ id: "outline", type: "line", source: "polygon", paint: { "line-color": colour("--accent"), "line-width": 2 } });
    map.addLayer({ id: "corners", type: "circle", source: "polygon", filter: ["==", "$type", "Point"], paint: { "circle-radius": 4, "circle-color": colour("--accent") } });
    map.on("dblclick", (event) => {
      if (!this.isDrawing) return;
      event.preventDefault();
      this.finish();
    });
    map.getCanvas().addEventListener("keydown", ({ key }) => {
      if (!this.isDrawing) return;
      if (key === "Escape") this.clear();
      if (key === "Backspace") {
        this.#corners.pop();
        this.#show();
      }
    });
    // (Without a geometry, statistics that are shown or being computed are dropped.)
    this.computeStatistics = latest(async (signal, geometry) => {
      this.#dropStatistics();
      if (geometry === undefined) return;
      this.#showStatistics(paragraph("…", "faint"));
      const feature = { type: "Feature", properties: {}, geometry };
      const { zones } = await dataset.zonal(feature, { crs: plane.crs, signal, progress: working }).catch((error) => {
        if (!signal.aborted) this.#dropStatistics();
        throw error;
      });
      const [zone] = zones;
      this.#showStatistics(...this.#report(zone));
      document.dispatchEvent(new CustomEvent("spinney-polygon", { detail: { geometry, crs: plane.crs, zone } }));
    });
  }

  start() {
    this.#corners = [];
    this.computeStatistics();
    this.isDrawing = true;
    element("panel").classList.add("drawing");
    this.map.doubleClickZoom.disable();
    this.map.getCanvas().style.cursor = "crosshair";
    this.#show();
  }

  stop() {
    this.isDrawing = false;
    element("panel").classList.remove("drawing");
    this.map.doubleClickZoom.enable();
    this.map.getCanvas().style.cursor = "";
    this.onEnd();
  }

  clear() {
    this.#corners = [];
    this.computeStatistics();
    this.stop();
    this.#show();
  }

  add({ lng, lat }) {
    const last = this.#corners.at(-1);
    // (A double click is two clicks at one position.)
    if (last && last[0] === lng && last[1] === lat) return;
    this.#corners.push([lng, lat]);
    this.#show();
  }

  finish() {
    if (this.#corners.length < 3) return this.clear();
    this.stop();
    const ring = [...this.#corners, this.#corners[0]].map(([lng, lat]) => this.plane.placeOf({ lng, lat }));
    this.computeStatistics({ type: "Polygon", coordinates: [ring] });
  }

  /** Shows statistics in the panel. */
  #showStatistics(...content) {
    this.#heading = fill("result", "Statistics of the polygon", ...content);
  }

  /** Removes the statistics of the polygon, unless something else has replaced them. */
  #dropStatistics() {
    if (this.#heading?.isConnected) clearResult();
  }

  #show() {
    const corners = this.#corners;
    const feature = (type, coordinates) => ({ type: "Feature", properties: {}, geometry: { type, coordinates } });
    const features = corners.map((corner) => feature("Point", corner));
    if (corners.length > 2) features.push(feature("Polygon", [[...corners, corners[0]]]));
    else if (corners.length === 2) features.push(feature("LineString", corners));
    this.map.getSource("polygon")?.setData({ type: "FeatureCollection", features });
  }

  #report(zone) {
    const made = [];
    const { cells, void_cells, channels, classes, unit } = zone;
    // Octrees have volumes, in cubic world units.
    const isVolume = "volume" in zone;
    const measureOf = (found) => (isVolume ? found.volume : found.area_m2) ?? null;
    const measureUnit = isVolume ? (unit === "cells" ? "cells" : `${unit ?? "unit"}³`) : "m²";
    const measure = measureOf(zone);
    if (classes.length) {
      const rows = classes.map((found) => [found.name || text(found.value), text(measureOf(found) ?? found.cells), `${((100 * found.cells) / cells).toFixed(2)} %`]);
      made.push(table(["class", measure === null ? "cells" : measureUnit, ""], rows));
    } else {
      channels.forEach((channel, at) => {
        const rows = ["mean", "min", "max", "sum", "standard_deviation"].map((name) => [name.replace("_", " "), text(channel[name])]);
        made.push(table([this.header.channelNames[at] || `band ${at + 1}`, ""], rows));
      });
    }
    const area = measure === null || measureUnit === "cells" ? "" : `, ${text(measure)} ${measureUnit}`;
    made.push(paragraph(`${text(cells)} cells${area}${void_cells ? `, ${text(void_cells)} without a value` : ""}`, "faint"));
    return made;
  }
}
